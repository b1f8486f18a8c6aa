"""`ta2 keys`: a certificate authority of the lab's own, certificates for gateway and clients, and the roles of these.

Rules it obeys
    * Private keys are for their user alone (0600), and nothing that is there is replaced without being asked.
    * `ca` stays with whoever gives keys, `server` goes to the gateway, `clients/NAME` to that client: each is whole.
    * A certificate is for one end: a client's cannot pass for the gateway, nor the gateway's for a client.
    * The name in a client's certificate is the one in the file of roles, by which the gateway knows it.
"""

from __future__ import annotations

import contextlib
import ipaddress
import json
import os
import tempfile
from argparse import Namespace
from datetime import datetime, timedelta, timezone
from pathlib import Path

from gateway.api.access.roles import USER_NAME, read_roles
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, GatewayError, failure
from gateway.settings.toml_file import state_dir

try:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError:
    raise failure(
        Code.BAD_REQUEST,
        "keys are made with the package cryptography, which is not installed",
        hint="install it: pip install 'teleavatar-gateway[keys]'",
    ) from None

__all__ = ["carry_out"]

CERTIFICATE, KEY, CA, CREDENTIALS, ROLES = "certificate.pem", "key.pem", "ca.pem", "credentials.json", "roles"
AT = "tls/HOST:7448"
STAYS = "the earlier key stays good until it ends: if it was lost, give a new name"
"""zenoh reads no list of revoked certificates."""
ANEW, ALL_ANEW = "make it anew with --replace", "make the authority anew: ta2 keys init --replace, then all keys"
SOON_DAYS = 30
"""Less is told as something to do."""


def carry_out(options: Namespace) -> ExitStatus:
    """Make or show keys.

    Raises:
        Rejected: BAD_REQUEST. There is no authority, there is such a key already, or a name is none.
    """
    folder = (options.dir or state_dir() / "keys").absolute()
    before = os.umask(0o077)
    try:
        {"init": _init, "server": _server, "client": _client, "list": _list}[options.verb](folder, options)
    except ValueError as error:
        raise _refused(
            f"no key can be made of that: {error}", "look at names, hosts, and the files of the authority"
        ) from None
    finally:
        os.umask(before)
    return ExitStatus.OK


def _init(folder: Path, options: Namespace) -> None:
    files = _made("ta2 lab", options.days, [x509.BasicConstraints(ca=True, path_length=0)], None)
    _write(folder / "ca", files, may_replace=options.replace, replaced="what was made before ends")
    print(f"the authority is in {folder / 'ca'}, good for {options.days} days")
    print("whoever has its key can make anybody an admin: keep it off the robot's host. Next: ta2 keys server HOST")


def _server(folder: Path, options: Namespace) -> None:
    hosts = x509.SubjectAlternativeName([_host(host) for host in options.hosts])
    own = [x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), hosts]
    at = folder / "server"
    _write(at, _made(options.hosts[0][:64], options.days, own, folder / "ca"), may_replace=options.replace)
    if not (at / ROLES).exists():
        _write(at, {ROLES: b"# NAME:ROLE a line: viewer, operator or admin\n"}, may_replace=False)
    print(f'# good {_until(at, folder)}; settings of the gateway:\n[local]\ntcp = "0.0.0.0:{AT.rpartition(":")[2]}"')
    names = {"tls_certificate": CERTIFICATE, "tls_private_key": KEY, "tls_root_ca": CA, "roles_file": ROLES}
    paths = {setting: at / name for setting, name in names.items()} | {"audit_log": state_dir() / "audit.jsonl"}
    for setting, path in paths.items():
        print(f"{setting} = {json.dumps(str(path))}")


def _client(folder: Path, options: Namespace) -> None:
    if USER_NAME.fullmatch(options.name) is None:
        raise _refused(
            f"{options.name!r} is no name", "letters, digits and . _ @ -, at most 64, a letter or digit first"
        )
    at, roles = folder / "clients" / options.name, folder / "server" / ROLES
    files = _made(options.name, options.days, [x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH])], folder / "ca")
    said = {"root_ca": CA, "certificate": CERTIFICATE, "private_key": KEY}
    _write(at, {**files, CREDENTIALS: json.dumps(said).encode()}, may_replace=options.replace)
    lines = roles.read_text(encoding="utf-8").splitlines() if roles.exists() else []
    kept = [line for line in lines if line.partition(":")[0].strip() != options.name]
    text = "".join(f"{line}\n" for line in [*kept, f"{options.name}:{options.role}"])
    _write(roles.parent, {ROLES: text.encode()}, may_replace=True)
    print(
        f"{options.name} ({options.role}) is in {at}, good {_until(at, folder)}. Give that folder to the client, then:"
    )
    print(f"  TA2_CREDENTIALS={at / CREDENTIALS} ta2 status --at {AT}")
    print(f"the gateway reads {roles} when it starts")


def _list(folder: Path, options: Namespace) -> None:
    path = folder / "server" / ROLES
    roles = read_roles(str(path)) if path.exists() else {}
    authority = _authority(folder)
    shown, ends_told = [], []
    for at in (folder / "ca", folder / "server", *sorted((folder / "clients").glob("*"))):
        if (at / CERTIFICATE).exists():
            certificate = _read(at / CERTIFICATE)
            ends, is_earlier = certificate.not_valid_after_utc, not _is_of(authority, certificate)
            role = str(roles.get(at.name, "viewer")) if at.parent.name == "clients" else ""
            left = (ends - datetime.now(timezone.utc)).days
            told = {"name": at.name, "role": role, "ends": ends.date().isoformat(), "days_left": left}
            shown.append({**told, "is_of_an_earlier_authority": is_earlier})
            end = "HAS ENDED" if left < 0 else "OF AN EARLIER AUTHORITY" if is_earlier else f"{left} days left"
            remedy = ALL_ANEW if not is_earlier and _ends_with(authority, certificate) else ANEW
            ends_told.append(f"{end}  <- {remedy}" if is_earlier or left < SOON_DAYS else end)
    if options.json:
        print(json.dumps({"ok": True, "keys": shown}))
        return
    for each, end in zip(shown, ends_told, strict=True):
        print(f"{each['name']:20} {each['role']:9} until {each['ends']}, {end}")
    if not shown:
        print(f"no keys in {folder}: begin with `ta2 keys init`")


def _is_of(authority: x509.Certificate | None, certificate: x509.Certificate) -> bool:
    """Return whether an authority has signed it, which nobody can tell where that is not here."""
    if authority not in (None, certificate):
        try:
            certificate.verify_directly_issued_by(authority)
        except (InvalidSignature, ValueError, TypeError):
            return False
    return True


def _made(name: str, days: int, extensions: list[x509.ExtensionType], signer: Path | None) -> dict[str, bytes]:
    """Return the files of a new certificate, signed by the authority in a folder, or by itself."""
    own, now = ec.generate_private_key(ec.SECP256R1()), datetime.now(timezone.utc)
    subject = issuer = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    key, ends, files = own, now + timedelta(days=days), {}
    if signer is not None:
        if not (signer / KEY).exists():
            raise _refused(f"there is no authority in {signer}", "make one: ta2 keys init")
        authority = _read(signer / CERTIFICATE)
        loaded = serialization.load_pem_private_key((signer / KEY).read_bytes(), password=None)
        if not isinstance(loaded, ec.EllipticCurvePrivateKey) or authority.not_valid_after_utc <= now:
            raise _refused(
                f"the authority in {signer} has ended, or is another's", "make it anew: ta2 keys init --replace"
            )
        key, issuer, ends = loaded, authority.subject, min(ends, authority.not_valid_after_utc)
        files[CA] = authority.public_bytes(serialization.Encoding.PEM)
    builder = x509.CertificateBuilder(issuer, subject, own.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - timedelta(hours=1)).not_valid_after(ends)  # clocks differ
    for extension in extensions:
        builder = builder.add_extension(extension, critical=isinstance(extension, x509.BasicConstraints))
    pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    files[CERTIFICATE] = builder.sign(key, hashes.SHA256()).public_bytes(pem)
    files[KEY] = own.private_bytes(pem, pkcs8, serialization.NoEncryption())
    return files


def _authority(folder: Path) -> x509.Certificate | None:
    """Return the certificate of the authority; None where it is kept elsewhere."""
    path = folder / "ca" / CERTIFICATE
    return _read(path) if path.exists() else None


def _until(at: Path, folder: Path) -> str:
    """Return in words when the certificate in `at` ends, which may be before the day that was asked for."""
    certificate = _read(at / CERTIFICATE)
    why = ", when the authority ends" if _ends_with(_authority(folder), certificate) else ""
    return f"until {certificate.not_valid_after_utc.date().isoformat()}{why}"


def _ends_with(authority: x509.Certificate | None, certificate: x509.Certificate) -> bool:
    """Return whether a certificate ends with its authority, so that one made anew would end no later."""
    return authority is not None and certificate.not_valid_after_utc >= authority.not_valid_after_utc


def _host(text: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(text.strip("[]")))
    except ValueError:
        return x509.DNSName(text.encode("ascii", "replace").decode())


def _read(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except (OSError, ValueError) as error:
        raise _refused(f"{path} cannot be read: {error}", "give the folder that `ta2 keys init` made") from None


def _write(folder: Path, files: dict[str, bytes], *, may_replace: bool, replaced: str = STAYS) -> None:
    """Write files for this user alone, each of them whole or not at all; `replaced` says what becomes of those before."""
    there = [name for name in files if (folder / name).exists()]
    if there and not may_replace:
        raise _refused(f"{folder} has {', '.join(there)} already", f"--replace makes it anew; {replaced}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            handle, temporary = tempfile.mkstemp(dir=folder, prefix=f".{name}.")  # 0600
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(temporary, folder / name)
            except BaseException:  # a key that nobody knows of would stay
                with contextlib.suppress(OSError):
                    os.unlink(temporary)
                raise
    except OSError as error:
        raise _refused(f"{folder} cannot be written: {error.strerror}", "give another folder with --dir") from None


def _refused(message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, message, hint=hint)
