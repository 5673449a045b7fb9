"""Direct connections, never through a proxy, to what stays on this machine or in the cell.

The variables that name a proxy are meant for the world outside. A robot, its cameras and a server
on the loopback address cannot be reached through one, and what is sent to them, keys and pictures
included, is not the proxy's to see.
"""

import ipaddress
import os
import socket
import urllib.request
from http.client import HTTPResponse
from typing import cast
from urllib.parse import urlsplit

_DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def open_directly(url: str, timeout_s: float) -> HTTPResponse:
    """The answer of a server of the cell, as `urllib.request.urlopen` gives it, asked without a
    proxy. Raises what that raises."""
    return cast(HTTPResponse, _DIRECT.open(url, timeout=timeout_s))


def origin(url: str) -> str:
    """The server that an address is of: scheme, host and port, as `https://example.org:443`.

    Raises:
        ValueError: it is no address of http or https.
    """
    parts = urlsplit(url)
    ports = {"http": 80, "https": 443}
    if parts.scheme not in ports or not parts.hostname:
        raise ValueError("it must begin with http:// or https:// and a host")
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname.rstrip(".")
    return f"{parts.scheme}://{host}:{parts.port or ports[parts.scheme]}"


def is_loopback(host: str) -> bool:
    """Whether a host, by name or address, is this machine: localhost, 127.0.0.0/8 in any spelling,
    ::1, or 0.0.0.0, which servers print as their own address."""
    name = host.strip("[]").rstrip(".").lower()
    if name == "localhost" or name.endswith(".localhost"):
        return True
    try:
        address = ipaddress.ip_address(name)
    except ValueError:
        try:
            address = ipaddress.ip_address(socket.inet_aton(name))  # 127.1, 0x7f000001
        except OSError:
            return False
    if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped is not None:
        address = address.ipv4_mapped
    return address.is_loopback or address.is_unspecified


def keep_direct(url: str) -> bool:
    """Take a loopback server out of what this process, and those that it starts, send to a proxy:
    its host is added to NO_PROXY, which every client library heeds. Returns whether that changed
    anything: a client that was made before reads it no more."""
    host = urlsplit(url).hostname or ""
    if not is_loopback(host):
        return False
    exempt = os.environ.get("no_proxy") or os.environ.get("NO_PROXY") or ""
    if host in [name.strip() for name in exempt.split(",")]:
        return False
    for variable in ("NO_PROXY", "no_proxy"):  # some read one, some the other
        os.environ[variable] = f"{exempt},{host}" if exempt else host
    return True
