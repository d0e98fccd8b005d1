"""Frames between our implementation of MAVLink and pymavlink's, which nobody here wrote."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.codec import Packer
from companion.mavlink.messages import unpack


def frame(message, sender=(1, 1)):
    """Pack somebody's message as pymavlink does."""
    return bytes(message.pack(mavlink.MAVLink(None, *sender)))


def received(message):
    """Return what our side makes of a message that pymavlink packs."""
    length = frame(message)[1]
    return unpack(message.get_msgId(), frame(message)[10 : 10 + length])


def seen(message):
    """Return what pymavlink makes of a message that we pack."""
    return mavlink.MAVLink(None).decode(bytearray(Packer(255, 190).encode(message)))


def name(message):
    """Return MAVLink's name of one of our messages."""
    return type(message).__name__
