"""What people look at: subscribes over Zenoh, never in the control process."""
