"""Every YAML or Python file that a user writes or we write: read, checked, and what is wrong said in one line."""

from hoopd.files.reading import InputError

__all__ = ["InputError"]
