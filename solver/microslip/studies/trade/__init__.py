"""The command `trade`: time and error of settings, measured against a reference of known error."""
