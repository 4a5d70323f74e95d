"""An instrument's lines of text as MAVLink readings that carry the time at which the water was taken in."""
