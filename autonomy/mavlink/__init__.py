"""How to speak with an autopilot, never when: sans-io codecs and protocol machines."""
