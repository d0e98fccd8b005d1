"""ArduSub's behaviour."""
