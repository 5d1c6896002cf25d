"""From sports video to scenes in metres: see it (`detect`), place it (`lift`), keep it (`dataset`)."""

__version__ = "0.1.0"
