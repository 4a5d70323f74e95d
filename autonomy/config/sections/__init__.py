"""The sections of the configuration: every key, default, range and meaning, by room."""
