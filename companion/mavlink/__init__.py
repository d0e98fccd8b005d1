"""The only room that imports pymavlink: a sans-I/O codec, and what is particular to ArduSub."""
