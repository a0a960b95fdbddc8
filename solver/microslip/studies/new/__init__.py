"""The command `new`: a first scene for a model file, with candidates for joints."""
