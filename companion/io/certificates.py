"""Certificates for vehicles on a network: a throw-away authority, and one Zenoh configuration for each end.

Whoever listens, a vehicle or the router of several, keeps listening on loopback for its own processes, and on
the network for whoever shows a certificate of this authority: TLS both ways. `access_control` says what each
may do. A companion to be commanded over the network must allow it too (`holdfast run --allow-control`). The
authority's own key is never written: for another laptop or vehicle, make all files again.
"""

import base64
import datetime
import ipaddress
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from companion.io.access_control import LAPTOP, RADIO_TICKS, access_control, downsampling
from companion.telemetry import schemas as telemetry

PORT = 7448
VEHICLE, ROUTER = "vehicle", "router"
LIFETIME = datetime.timedelta(days=365)


def make(
    directory: Path,
    hosts: Sequence[str],
    *,
    allow_control: bool,
    now: datetime.datetime,
    vehicles: Sequence[str] = (),
    radio: bool = False,
    port: int = PORT,
    local: str = telemetry.ENDPOINT,
) -> list[Path]:
    """Write the configuration of who listens, of the laptop and of each of `vehicles`; return the paths.

    Who listens is the vehicle or, if `vehicles` are named, a router for them; `hosts` are its names and
    addresses, as the others call it. A vehicle of a router listens on loopback for its own processes. With
    `radio` the laptop gets one tick of RADIO_TICKS and no raw ticks; processes on the listening machine get
    all. Raises FileExistsError rather than write over keys that are in use, and ValueError for a vehicle's
    name that cannot be one.
    """
    for name in vehicles:
        telemetry.keys(name)
        if name in (LAPTOP, ROUTER, VEHICLE) or vehicles.count(name) > 1:
            raise ValueError(
                f"vehicle name '{name}': each name once, and none of {LAPTOP}, {ROUTER}, {VEHICLE}"
            )
    authority = _Authority(now)
    centre: dict[str, Any] = {
        "mode": "router" if vehicles else "peer",
        "listen": {"endpoints": [local, f"tls/0.0.0.0:{port}"], "timeout_ms": 0},
        "connect": {"endpoints": []},
        "transport": _transport(authority.issue(ROUTER if vehicles else VEHICLE, hosts, "listen")),
        "timestamping": {"enabled": True},
        "access_control": access_control(allow_control=allow_control, radio=radio, vehicles=vehicles),
    }
    configs = {ROUTER if vehicles else VEHICLE: centre}
    endpoints = [f"tls/{f'[{host}]' if ':' in host else host}:{port}" for host in hosts]
    for name in (LAPTOP, *vehicles):
        configs[name] = {
            "mode": "client" if name == LAPTOP else "peer",
            "connect": {
                "endpoints": endpoints,
                "timeout_ms": 0
                if name == LAPTOP
                else -1,  # a peer starts without its router, and goes on trying
                "exit_on_failure": name == LAPTOP,
                "retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
            },
            "listen": {"endpoints": [] if name == LAPTOP else [telemetry.ENDPOINT], "timeout_ms": 0},
            "transport": {
                "unicast": {"open_timeout": 2000},
                **_transport(authority.issue(name, (), "connect")),
            },
            "timestamping": {"enabled": name != LAPTOP},
        }
    if radio:
        centre["downsampling"] = [downsampling(vehicles)]
        configs[LAPTOP]["metadata"] = {telemetry.TICKS_PER_SAMPLE: RADIO_TICKS}
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for name, config in configs.items():
        config["scouting"] = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
        path = directory / f"{name}.json5"
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(json.dumps(config, indent=2) + "\n", encoding="utf-8")
        written.append(path)
    return written


def _transport(certificate: dict[str, str]) -> dict[str, Any]:
    return {
        "shared_memory": {"enabled": False},
        "link": {
            "tx": {"queue": {"size": telemetry.BATCHES}},
            "tls": {"enable_mtls": True, **certificate},
        },
    }


class _Authority:
    """Issues certificates for as long as this object lives."""

    def __init__(self, now: datetime.datetime) -> None:
        self._now = now
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _name("holdfast throw-away authority")
        builder = self._builder(self._name, self._key).add_extension(
            x509.BasicConstraints(ca=True, path_length=0), critical=True
        )
        self._certificate = builder.sign(self._key, hashes.SHA256())

    def issue(self, common_name: str, hosts: Sequence[str], role: str) -> dict[str, str]:
        """Return the keys of Zenoh's tls section for one end; `role` is "listen" or "connect"."""
        key = ec.generate_private_key(ec.SECP256R1())
        usage = ExtendedKeyUsageOID.SERVER_AUTH if role == "listen" else ExtendedKeyUsageOID.CLIENT_AUTH
        builder = (
            self._builder(_name(common_name), key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
            .add_extension(
                x509.SubjectAlternativeName([_host(host) for host in hosts or (common_name,)]), critical=False
            )
        )
        certificate = builder.sign(self._key, hashes.SHA256())
        private = key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        return {
            "root_ca_certificate_base64": _base64(_pem(self._certificate)),
            f"{role}_certificate_base64": _base64(_pem(certificate)),
            f"{role}_private_key_base64": _base64(private),
        }

    def _builder(self, subject: x509.Name, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(self._name)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(self._now - datetime.timedelta(days=1))
            .not_valid_after(self._now + LIFETIME)
        )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
