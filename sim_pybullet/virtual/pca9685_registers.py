"""A PCA9685 at the level of bytes on the wire (NXP data sheet Rev. 4; chapters are named below).

Where the data sheet leaves the result of an access open, the model raises ChipMisuseError: a driver
that does such a thing is wrong even if one chip puts up with it. Time comes from the clock, because
waking takes 500 us and RESTART is set at the end of a PWM period.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from robot.hat.clock import Clock
from sim_pybullet.virtual.pwm import FULL, ChipMisuseError, PwmOutputs

RESTART, EXTCLK, AI, SLEEP, ALLCALL = 0x80, 0x40, 0x20, 0x10, 0x01  # MODE1, table 5
SUB_BITS = (0x08, 0x04, 0x02)
INVRT, OCH, OUTDRV = 0x10, 0x08, 0x04  # MODE2, table 6
MODE1, MODE2, SUBADR1, ALLCALLADR, LED0, LED_END = 0x00, 0x01, 0x02, 0x05, 0x06, 0x46
ALL_LED, PRE_SCALE, TEST_MODE = 0xFA, 0xFE, 0xFF
RESET_VALUES = (0x11, 0x04, 0xE2, 0xE4, 0xE8, 0xE0)
GENERAL_CALL, SOFTWARE_RESET = 0x00, 0x06  # chapter 7.6
OSCILLATOR_HZ = 25e6
OSCILLATOR_START_S = 500e-6
# Auto-increment rolls over after LED15 and after PRE_SCALE (chapter 7.3).
ROLL_OVER = {LED_END - 1: 0x00, PRE_SCALE: 0x00}


class Pca9685Registers:
    """The chip, driven one byte at a time by the bus: start, write or read, stop.

    Args:
        address: the 7-bit address set by the pins.
        clock: for oscillator start-up and PWM periods.
        before_change: called before the outputs take new values.
        after_change: called after they took them.
    """

    def __init__(
        self,
        address: int,
        clock: Clock,
        before_change: Callable[[], None] = lambda: None,
        after_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.address = address
        self._clock = clock
        self._before_change = before_change
        self._after_change = after_change
        self._pwm_written = False
        self._power_on()

    @property
    def outputs(self) -> PwmOutputs:
        """The sixteen outputs as they are now."""
        return self._outputs

    @property
    def asleep(self) -> bool:
        """Whether the oscillator is off."""
        return bool(self._mode1 & SLEEP)

    @property
    def pwm_period_s(self) -> float:
        """Duration of 4096 counts [s] (chapter 7.3.5)."""
        return 4096 * (self._pre_scale + 1) / OSCILLATOR_HZ

    def power_cycle(self) -> None:
        """Supply lost and back: all registers at their reset values."""
        self._before_change()
        self._power_on()
        self._after_change()

    # -- the wire

    def start(self, address: int, read: bool) -> bool:
        """START or repeated START with an address byte; True where the chip acknowledges."""
        self._general_call = address == GENERAL_CALL and not read
        self._bytes_written = 0
        self._selected = self._general_call or address in self._addresses()
        return self._selected

    def write(self, value: int) -> bool:
        """One byte from the master; True where the chip acknowledges it."""
        self._bytes_written += 1
        if self._general_call:
            self._reset_armed = self._bytes_written == 1 and value == SOFTWARE_RESET
            return self._reset_armed
        if self._bytes_written == 1:
            self._pointer = value
            return not LED_END <= value < ALL_LED
        return self._write_register(value)

    def read(self) -> int:
        """One byte for the master."""
        value = self._register(self._pointer)
        self._advance_pointer()
        return value

    def stop(self) -> None:
        """STOP: a software reset takes effect, or outputs change where OCH = 0."""
        if self._reset_armed:
            self.power_cycle()
        elif self._selected and self._pwm_written:
            inside = LED0 <= self._pointer < LED_END and (self._pointer - LED0) % 4
            self._cut_off = (self._pointer - LED0) // 4 if inside else None
            if not self._mode2 & OCH:
                self._restart_s = math.inf  # chapter 7.3.1.1: any PWM write ends RESTART
                self._latch(range(16))
            self._pwm_written = False
        self._selected = self._general_call = self._reset_armed = False

    # -- registers

    def _power_on(self) -> None:
        self._mode1, self._mode2 = RESET_VALUES[:2]
        self._sub_addresses = list(RESET_VALUES[2:])  # SUBADR1-3, ALLCALLADR
        self._led = bytearray((0, 0, 0, FULL) * 16)
        self._latched = bytearray(self._led)
        self._pre_scale = 0x1E
        self._pointer = 0
        self._restart_s = math.inf  # from when on RESTART reads 1; outputs wait for it
        self._awake_s = math.inf  # since when the oscillator runs
        self._selected = self._general_call = self._reset_armed = self._pwm_written = False
        self._bytes_written = 0
        self._cut_off = None  # the channel within which the last write ended
        self._outputs = PwmOutputs.all_low()

    def _addresses(self) -> set[int]:
        enabled = [self._mode1 & bit for bit in (*SUB_BITS, ALLCALL)]
        others = (a >> 1 for i, a in enumerate(self._sub_addresses) if enabled[i])
        return {self.address, *others}

    def _register(self, register: int) -> int:
        if register == MODE1:
            pending = self._clock.now() >= self._restart_s
            return self._mode1 | (RESTART if pending else 0)
        if register == MODE2:
            return self._mode2
        if register < LED0:
            return self._sub_addresses[register - SUBADR1]
        if register < LED_END:
            return self._led[register - LED0]
        if ALL_LED <= register < PRE_SCALE:
            return 0
        if register == PRE_SCALE:
            return self._pre_scale
        raise ChipMisuseError(f"read of register 0x{register:02X}: reserved")

    def _write_register(self, value: int) -> bool:
        register = self._pointer
        if LED_END <= register < ALL_LED:
            return False
        if register == TEST_MODE:
            raise ChipMisuseError("write to TestMode (0xFF): for the manufacturer only")
        if register == MODE1:
            self._write_mode1(value)
        elif register == MODE2:
            self._mode2 = value & 0x1F
            self._refresh()
        elif register < LED0:
            self._sub_addresses[register - SUBADR1] = value & 0xFE
        elif register == PRE_SCALE:
            if self._mode1 & SLEEP:
                self._pre_scale = max(value, 3)
        else:
            self._write_pwm(register, value)
        self._advance_pointer()
        return True

    def _write_mode1(self, value: int) -> None:
        was_asleep = self.asleep
        sticky = self._mode1 & EXTCLK
        if value & EXTCLK and was_asleep and value & SLEEP:
            sticky = EXTCLK  # chapter 7.3.1: only while asleep, and only a reset clears it
        self._mode1 = value & (AI | SLEEP | 0x0F) | sticky
        now_s = self._clock.now()
        if self.asleep and not was_asleep:
            if self._outputs.any_pwm:
                self._restart_s = now_s + self.pwm_period_s
            self._awake_s = math.inf
        elif was_asleep and not self.asleep:
            self._awake_s = now_s
        if value & RESTART and not self.asleep and now_s >= self._restart_s:
            if now_s < self._awake_s + OSCILLATOR_START_S:
                raise ChipMisuseError("RESTART within 500 us of waking (chapter 7.3.1.1)")
            self._restart_s = math.inf
        self._refresh()

    def _write_pwm(self, register: int, value: int) -> None:
        field = (register - LED0) % 4 if register < LED_END else register - ALL_LED
        value &= 0x1F if field % 2 else 0xFF
        channels = [(register - LED0) // 4] if register < LED_END else range(16)
        for channel in channels:
            self._led[4 * channel + field] = value
        self._pwm_written = True
        if field == 3 and self._mode2 & OCH:
            self._latch(channels)

    def _advance_pointer(self) -> None:
        if self._mode1 & AI:
            self._pointer = ROLL_OVER.get(self._pointer, self._pointer + 1)

    # -- outputs

    def _latch(self, channels: range | list[int]) -> None:
        if not self.asleep and self._clock.now() < self._awake_s + OSCILLATOR_START_S:
            raise ChipMisuseError("outputs used within 500 us of waking (chapter 7.3.1)")
        for channel in channels:
            registers = slice(4 * channel, 4 * channel + 4)
            self._latched[registers] = self._led[registers]
        self._refresh()

    def _refresh(self) -> None:
        """Work out the outputs afresh, telling who watches them."""
        if self.asleep or self._restart_s < math.inf:
            outputs = PwmOutputs.all_low()
        else:
            inverted = bool(self._mode2 & INVRT)
            outputs = PwmOutputs.from_registers(bytes(self._latched), inverted, self._cut_off)
            if not self._mode2 & OUTDRV and outputs.any_high:
                raise ChipMisuseError(
                    "OUTDRV = 0: open drain cannot drive the bridges' inputs high"
                )
        if outputs != self._outputs:
            self._before_change()
            self._outputs = outputs
            self._after_change()
