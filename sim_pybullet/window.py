"""A window that shows pictures, where there is a screen."""

from __future__ import annotations

from typing import Any

import numpy as np


class Window:
    """Opens with the first picture; matplotlib's, which draws nothing where there is no screen."""

    def __init__(self) -> None:
        self._image: Any = None

    def show(self, picture: np.ndarray, for_s: float) -> None:
        """Show a picture (H, W, 3) uint8 for so many seconds; it stays until the next."""
        import matplotlib.pyplot as plt

        if self._image is None:
            plt.ion()
            axes = plt.subplots(num="duckpilot", clear=True)[1]
            axes.axis("off")
            self._image = axes.imshow(picture)
        self._image.set_data(picture)
        canvas = self._image.figure.canvas
        canvas.draw_idle()
        canvas.start_event_loop(for_s)

    def close(self) -> None:
        """Close it, if it is open."""
        if self._image is not None:
            import matplotlib.pyplot as plt

            plt.close(self._image.figure)
            self._image = None
