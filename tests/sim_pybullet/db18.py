"""The drive of the reference simulator's robot."""

from sim_pybullet.look import DriveLook

# Duckietown's DB18 with DC motors: u' = -5u + 1.5(R+L), w' = -4w + 15(R-L), R and L in [-1, 1] of
# 0.6 m/s, so that a 0.102 m axle turns at 0.6375 of the kinematic rate (gym-duckietown 6.1.34). Its
# delay of 0.15 s acts after 4 of its steps of 1/30 s, now and then after 3, as its clock rounds.
DB18_DRIVE = DriveLook(
    forward_lag_s=0.2, turn_lag_s=0.25, delay_s=4 / 30, turn_gain=3.75 * 0.102 / 0.6, noise=0.0
)
