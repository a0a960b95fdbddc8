"""Input files of Abaqus and CalculiX (.inp), read whole."""
