"""The links' fixtures, here too."""

from tests.robot.link.conftest import configs, key_folders

__all__ = ["configs", "key_folders"]
