"""The process on the vehicle: reads ArduSub's telemetry, holds the vehicle, answers with thrust."""
