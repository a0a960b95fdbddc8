"""Files of other programs: what they hold, in one common form, before a scene says what is used of it."""
