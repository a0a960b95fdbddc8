"""The commands other than run, built on the library: check, new, compare, verify, trade, export, diff, batches."""
