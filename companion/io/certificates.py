"""Certificates for a vehicle on a network: a throw-away authority, and one Zenoh configuration for each end.

The vehicle keeps listening on loopback for its own processes, and on the network for whoever shows a
certificate of this authority: TLS both ways. A laptop may see and subscribe; it may command only if it was
allowed to here, and the companion to be commanded (`holdfast run --allow-control`). The authority's own key
is never written: for another laptop, make all anew.
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

from companion.telemetry import schemas as telemetry

PORT = 7448
VEHICLE, LAPTOP = "vehicle", "laptop"
TICK_HZ = 50.0
RADIO_TICKS = 10
LIFETIME = datetime.timedelta(days=365)
SEEN = ("holdfast/**", "holdfast/**/@adv/**", "sim/**")
ASKED = ("holdfast/**", "holdfast/**/@adv/**")
COMMANDED = ("holdfast/*/command/**",)


def make(
    directory: Path,
    hosts: Sequence[str],
    *,
    allow_control: bool,
    now: datetime.datetime,
    radio: bool = False,
    port: int = PORT,
    local: str = telemetry.ENDPOINT,
) -> list[Path]:
    """Write vehicle.json5 and laptop.json5 and return their paths.

    `hosts` are the vehicle's names and addresses, as the laptop calls it. With `radio` the laptop gets one
    tick of RADIO_TICKS and no raw ticks; processes on the vehicle get all. Raises FileExistsError rather than
    write over keys that are in use.
    """
    authority = _Authority(now)
    vehicle: dict[str, Any] = {
        "mode": "peer",
        "listen": {"endpoints": [local, f"tls/0.0.0.0:{port}"], "timeout_ms": 0},
        "connect": {"endpoints": []},
        "transport": {
            "shared_memory": {"enabled": False},
            "link": {
                "tx": {"queue": {"size": telemetry.BATCHES}},
                "tls": {"enable_mtls": True, **authority.issue(VEHICLE, hosts, "listen")},
            },
        },
        "timestamping": {"enabled": True},
        "access_control": _access(allow_control, radio),
    }
    laptop: dict[str, Any] = {
        "mode": "client",
        "connect": {
            "endpoints": [f"tls/{f'[{host}]' if ':' in host else host}:{port}" for host in hosts],
            "timeout_ms": 0,
            "retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2},
        },
        "listen": {"endpoints": []},
        "transport": {
            "shared_memory": {"enabled": False},
            "unicast": {"open_timeout": 2000},
            "link": {"tls": {"enable_mtls": True, **authority.issue(LAPTOP, (), "connect")}},
        },
    }
    if radio:
        vehicle["downsampling"] = [_downsampling()]
        laptop["metadata"] = {telemetry.TICKS_PER_SAMPLE: RADIO_TICKS}
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    for name, config in ((VEHICLE, vehicle), (LAPTOP, laptop)):
        config["scouting"] = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
        path = directory / f"{name}.json5"
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(json.dumps(config, indent=2) + "\n", encoding="utf-8")
        written.append(path)
    return written


def _downsampling() -> dict[str, Any]:
    """Return what makes Zenoh pass one tick of RADIO_TICKS to the laptop.

    Zenoh lets a sample pass if the key's last one is old enough. A period half a tick shorter than wanted
    keeps the keys of a tick together when a tick comes late.
    """
    keys = [*(f"holdfast/*/{tail}" for tail in telemetry.EVERY_TICK), "sim/*/truth"]
    hz = TICK_HZ / (RADIO_TICKS - 0.5)
    return {
        "id": "radio",
        "link_protocols": ["tls"],
        "flows": ["egress"],
        "messages": ["put"],
        "rules": [{"key_expr": key, "freq": round(hz, 3)} for key in keys],
    }


def _access(allow_control: bool, radio: bool) -> dict[str, Any]:
    """Return Zenoh's access control: everything on loopback, a laptop what is named, others nothing."""
    messages = {
        "to": (["put", "delete", "declare_queryable", "liveliness_token", "reply"], ["egress"], SEEN),
        "subscribe": (
            ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"],
            ["ingress"],
            SEEN,
        ),
        "ask": (["query"], ["ingress"], ASKED),
    }
    everything = [
        *("put", "delete", "declare_subscriber", "query", "reply", "declare_queryable"),
        *("liveliness_token", "liveliness_query", "declare_liveliness_subscriber"),
    ]
    rules = [
        {"id": name, "permission": "allow", "flows": flows, "messages": kinds, "key_exprs": list(keys)}
        for name, (kinds, flows, keys) in messages.items()
    ]
    if not allow_control:  # a companion drops what asks for several commands at once: `**` is no way in
        rules.append(_denied("command", "ingress", "query", COMMANDED))
    if radio:
        rules.append(_denied("raw", "egress", "put", ("holdfast/*/raw",)))
    laptop = [rule["id"] for rule in rules]
    anything = ["**", "**/@adv/**"]
    all_flows = ["ingress", "egress"]
    rules.append(
        {
            "id": "all",
            "permission": "allow",
            "flows": all_flows,
            "messages": everything,
            "key_exprs": anything,
        }
    )
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [
            {"id": "loopback", "link_protocols": ["tcp"]},
            {"id": LAPTOP, "link_protocols": ["tls"], "cert_common_names": [LAPTOP]},
        ],
        "policies": [
            {"rules": ["all"], "subjects": ["loopback"]},
            {"rules": laptop, "subjects": [LAPTOP]},
        ],
    }


def _denied(name: str, flow: str, message: str, keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "deny",
        "flows": [flow],
        "messages": [message],
        "key_exprs": list(keys),
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
