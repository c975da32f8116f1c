"""Tools that every other layer may use: windows and regions of a recording, bits, files, random streams, cores."""
