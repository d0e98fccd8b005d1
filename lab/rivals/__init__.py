"""What Holdfast is measured against: other laws in its own engine, and ArduSub's depth hold on board."""
