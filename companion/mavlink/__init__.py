"""The only package that imports pymavlink: a sans-I/O codec, and the messages of ArduSub."""
