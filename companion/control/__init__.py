"""Pure maths: the law, the network, the reference. Imports only companion.types, numpy and math."""
