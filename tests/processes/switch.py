"""Hosts on one machine: network namespaces with one address each, and the switch between them.

``python switch.py N`` needs to be root. It makes N namespaces, in which host K has the address
10.0.0.K+1, and prints their files in one line. Each line of JSON on its standard input then says
what becomes of frames: `[from, to, loss, delay]`, with the share that is lost and the seconds that
the others take. Nothing of it outlives this process and those that it hosts, however they end.
"""

import ctypes
import fcntl
import heapq
import json
import os
import select
import socket
import struct
import sys
import time
from random import Random

_NEW_NETWORK = 0x40000000
_SET_TAP, _TAP_WITHOUT_INFO = 0x400454CA, 0x1002
_SET_FLAGS, _UP = 0x8914, 1
_SET_ADDRESS, _SET_MASK, _SET_MAC = 0x8916, 0x891C, 0x8924
_ETHERNET = 1
_FRAME_BYTES_MAX = 1 << 16


def mac(host: int) -> bytes:
    """Return the hardware address of a host."""
    return bytes((2, 0, 0, 0, 0, host))


def _port(host: int) -> int:
    """Move to a new namespace, and return a descriptor of what its one interface sends and gets."""
    if ctypes.CDLL(None, use_errno=True).unshare(_NEW_NETWORK):
        raise OSError(ctypes.get_errno(), "no new network")
    port = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(port, _SET_TAP, struct.pack("16sH22x", b"tap", _TAP_WITHOUT_INFO))

    def address(text: str) -> bytes:
        return struct.pack("16sHH4s16x", b"tap", socket.AF_INET, 0, socket.inet_aton(text))

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        hardware = struct.pack("16sH6s16x", b"tap", _ETHERNET, mac(host))
        fcntl.ioctl(any_socket, _SET_MAC, hardware)
        fcntl.ioctl(any_socket, _SET_ADDRESS, address(f"10.0.0.{host + 1}"))
        fcntl.ioctl(any_socket, _SET_MASK, address("255.255.255.0"))
        for name in (b"lo", b"tap"):
            fcntl.ioctl(any_socket, _SET_FLAGS, struct.pack("16sH22x", name, _UP))
    return port


class Switch:
    """Frames on their way."""

    def __init__(self, ports: list[int]) -> None:
        """Begin with links that lose and delay nothing."""
        self._ports = ports
        self._random = Random(0)  # noqa: S311 - a seeded one
        self._links: dict[tuple[int, int], tuple[float, float]] = {}
        self._late: list[tuple[float, int, int, bytes]] = []
        self._count = 0

    def set(self, sender: int, receiver: int, loss: float, delay_s: float) -> None:
        """Say what becomes of frames from one host to another."""
        self._links[sender, receiver] = loss, delay_s

    def take(self, sender: int) -> None:
        """Pass on what a host has sent."""
        while True:
            try:
                frame = os.read(self._ports[sender], _FRAME_BYTES_MAX)
            except BlockingIOError:
                return
            to = frame[:6]
            for receiver in range(len(self._ports)):
                if receiver != sender and (to[0] & 1 or to == mac(receiver)):
                    self._send(sender, receiver, frame)

    def _send(self, sender: int, receiver: int, frame: bytes) -> None:
        loss, delay_s = self._links.get((sender, receiver), (0.0, 0.0))
        if self._random.random() < loss:
            return
        self._count += 1
        heapq.heappush(self._late, (time.monotonic() + delay_s, self._count, receiver, frame))

    def deliver(self) -> float | None:
        """Deliver what is due; return the seconds until more is."""
        while self._late:
            wait = self._late[0][0] - time.monotonic()
            if wait > 0:
                return wait
            _, _, receiver, frame = heapq.heappop(self._late)
            os.write(self._ports[receiver], frame)
        return None


def main(hosts: int) -> None:
    """Serve until standard input closes."""
    ports, files = [], []
    for host in range(hosts):
        ports.append(_port(host))
        network = os.open("/proc/self/ns/net", os.O_RDONLY)
        files.append(f"/proc/{os.getpid()}/fd/{network}")
    print(*files, flush=True)
    switch = Switch(ports)
    text = b""
    while True:
        ready = select.select([0, *ports], [], [], switch.deliver())[0]
        for sender, port in enumerate(ports):
            if port in ready:
                switch.take(sender)
        if 0 in ready:
            data = os.read(0, 1 << 16)
            if not data:
                return
            *lines, text = (text + data).split(b"\n")
            for line in lines:
                switch.set(*json.loads(line))


if __name__ == "__main__":
    main(int(sys.argv[1]))
