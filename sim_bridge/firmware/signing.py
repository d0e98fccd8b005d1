"""The firmware's store of the MAVLink 2 signing key: it outlives reboots and goes for every link."""

import hashlib

UTC_AT_BOOT_S = 1_760_000_000

MAVLINK_EPOCH_S = 1_420_070_400


class KeyStore:
    """The key, None for no signing, and the timestamp (10 µs since 2015) that signing starts from."""

    def __init__(self, passphrase: str) -> None:
        self.key = hashlib.sha256(passphrase.encode()).digest() if passphrase else None
        self.timestamp = (UTC_AT_BOOT_S - MAVLINK_EPOCH_S) * 100_000

    def set_up(self, key: bytes, timestamp: int) -> None:
        """Take a new key (SETUP_SIGNING); all zero bytes take it away."""
        self.key = key if any(key) else None
        self.timestamp = max(self.timestamp, timestamp)
