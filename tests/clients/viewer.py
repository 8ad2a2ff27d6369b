#!/usr/bin/env python3
"""A viewer of a third party: Python's standard library and WIRE.md, part 2, nothing else.

It joins a session, keeps a copy of bone and cut, answers the last digest and prints what it found as
one line of JSON. With --break-after N it hangs up after N messages, without a word, and comes back to
its seat. Exit code 0 where its digest is the haptics process's.
"""

import argparse
import json
import socket
import struct
import sys
import time

from xxh3 import xxh3_64

VERSION = 4
MAX_PAYLOAD = 1 << 20
PIECE_BYTES = 196_608
BRICK_BYTES = 1024
CHUNK_VALUES = 32_768
UNCUT = struct.pack("<h", 32_767)
HELLO, REFUSED, SCENE, PIECE, POSE, REMOVALS, BRICKS, DIGEST, HEALTH, RESET, BYE, UNDONE, WELCOME, CONTROL, DENIED = (
    range(15)
)


class WireError(Exception):
    """What came is not of this protocol."""


def crc_table():
    table = []
    for n in range(256):
        for _ in range(8):
            n = n >> 1 ^ (0x82F63B78 if n & 1 else 0)
        table.append(n)
    return table


TABLE = crc_table()


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc = TABLE[(crc ^ byte) & 255] ^ crc >> 8
    return crc ^ 0xFFFFFFFF


def varint(n):
    out = bytearray()
    while n > 127:
        out.append(n & 127 | 128)
        n >>= 7
    out.append(n)
    return bytes(out)


def text(s):
    raw = s.encode()
    return varint(len(raw)) + raw


class Fields:
    """Reads the fields of one payload."""

    def __init__(self, payload):
        self.payload, self.at = payload, 0

    def take(self, count):
        if self.at + count > len(self.payload):
            raise WireError("a field goes beyond its message")
        self.at += count
        return self.payload[self.at - count : self.at]

    def u8(self):
        return self.take(1)[0]

    def boolean(self):
        value = self.u8()
        if value > 1:
            raise WireError("a bool that is none")
        return value == 1

    def varint(self, most=(1 << 64) - 1):
        value = shift = 0
        while True:
            byte = self.u8()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
            if shift > 63:
                raise WireError("a varint without an end")
        if value > most:
            raise WireError("a number out of its range")
        return value

    def floats(self, form, count):
        return struct.unpack(f"<{count}{form}", self.take(count * struct.calcsize(form)))

    def text(self, most=1024):
        return self.take(self.varint(most)).decode()

    def bytes(self):
        return self.take(self.varint(MAX_PAYLOAD))

    def option(self):
        return self.varint() if self.boolean() else None

    def end(self):
        if self.at != len(self.payload):
            raise WireError("bytes left over")


def unpack_lz4(block, size):
    """One LZ4 block that makes exactly `size` bytes."""
    out = bytearray()
    at = 0

    def length(start):
        nonlocal at
        total = start
        while start == 15:
            byte = block[at]
            at += 1
            total += byte
            if byte != 255:
                break
        return total

    try:
        while True:
            token = block[at]
            at += 1
            literals = length(token >> 4)
            if at + literals > len(block):
                raise WireError("an LZ4 block that ends early")
            out += block[at : at + literals]
            at += literals
            if at == len(block):
                break
            back = block[at] | block[at + 1] << 8
            at += 2
            count = length(token & 15) + 4
            start = len(out) - back
            if back == 0 or start < 0 or len(out) + count > size:
                raise WireError("an LZ4 block that points outside")
            while count > 0:
                part = out[start : start + min(back, count)]
                out += part
                start += len(part)
                count -= len(part)
    except IndexError:
        raise WireError("an LZ4 block that ends early") from None
    if len(out) != size:
        raise WireError("an LZ4 block of another size")
    return bytes(out)


class Mirror:
    """Bone and cut as the messages make them."""

    def __init__(self):
        self.scene = None
        self.coords = []
        self.solid_voxels = 0
        self.cut = {}
        self.epoch = self.batches = self.bricks = self.poses = 0
        self.removed_mm3 = 0.0

    def take_scene(self, f):
        scene = {"source": f.text()}
        scene["dims"] = [f.varint(4096) for _ in range(3)]
        scene["spacing_mm"] = f.floats("d", 3)
        f.floats("d", 14)  # lps_from_bone, bone_from_plan
        scene["chunks"] = f.varint(1 << 21)
        (scene["solid_mm3"],) = f.floats("d", 1)
        scene["tools"] = []
        for _ in range(f.varint(8)):
            name, _ = f.text(200), f.text(200)
            f.floats("f", 2 * f.varint(256) + 1)  # outline, rpm
            scene["tools"].append(name)
        f.floats("d", 2)  # force_limit_n, force_scale
        self.__init__()
        self.scene = scene

    def take_piece(self, f):
        chunk = f.varint()
        if chunk != len(self.coords):
            raise WireError("bone pieces out of order")
        self.coords.append(tuple(f.varint(127) for _ in range(3)))
        f.varint()  # bony
        raw = unpack_lz4(f.bytes(), PIECE_BYTES)
        solid = struct.unpack_from(f"<{CHUNK_VALUES}h", raw, 2 * CHUNK_VALUES)
        self.solid_voxels += sum(1 for d in solid if d > 0)

    def take_bricks(self, f):
        epoch, _revision = f.varint(), f.varint()
        ids = [(f.varint(), f.u8()) for _ in range(f.varint(256))]
        values = unpack_lz4(f.bytes(), BRICK_BYTES * len(ids))
        self.batches += 1
        if epoch < self.epoch:
            return
        if epoch > self.epoch:
            self.reset(epoch)
        for n, (chunk, brick) in enumerate(ids):
            if chunk >= len(self.coords) or brick >= 64:
                raise WireError("a brick that is not there")
            cut = self.cut.setdefault(chunk, bytearray(UNCUT * CHUNK_VALUES))
            cut[brick * BRICK_BYTES : (brick + 1) * BRICK_BYTES] = values[n * BRICK_BYTES : (n + 1) * BRICK_BYTES]
        self.bricks += len(ids)

    def reset(self, epoch):
        self.cut.clear()
        self.epoch, self.removed_mm3 = epoch, 0.0

    def digest(self, epoch, revision):
        if epoch > self.epoch:
            self.reset(epoch)
        uncut = UNCUT * CHUNK_VALUES
        whole = struct.pack("<IQ", self.epoch, revision)
        changed = 0
        for chunk in sorted(self.cut):
            if self.cut[chunk] != uncut:
                changed += 1
                whole += struct.pack("<3HQ", *self.coords[chunk], xxh3_64(self.cut[chunk]))
        return xxh3_64(whole), changed

    def solid_mm3(self):
        x, y, z = self.scene["spacing_mm"]
        return self.solid_voxels * x * y * z


class Viewer:
    """One connection after the other to the same seat."""

    def __init__(self, path):
        self.path = path
        self.mirror = Mirror()
        self.welcome = None
        self.messages = 0
        self.result = {"resumed": False}

    def join(self):
        self.stream = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.stream.settimeout(30)
        self.stream.connect(self.path)
        self.buffer = bytearray()
        self.send(bytes([0]) + varint(VERSION) + text("viewer.py"))
        capabilities = 2 | 4 | 8 | 16  # removals, health, digest, seat kept; never in control
        resume = bytes([0])
        if self.welcome:
            m = self.mirror
            numbers = (*self.welcome, len(m.coords), m.batches, m.epoch)
            resume = bytes([1]) + b"".join(map(varint, numbers))
        self.send(bytes([3, 2]) + varint(capabilities) + varint(60) + resume)

    def send(self, payload):
        self.stream.sendall(struct.pack("<II", len(payload), crc32c(payload)) + payload)

    def read(self, count):
        while len(self.buffer) < count:
            part = self.stream.recv(65_536)
            if not part:
                raise WireError("the connection ended without a farewell")
            self.buffer += part
        taken = bytes(self.buffer[:count])
        del self.buffer[:count]
        return taken

    def next(self):
        length, crc = struct.unpack("<II", self.read(8))
        if length > MAX_PAYLOAD:
            raise WireError("a message that is too long")
        payload = self.read(length)
        if crc32c(payload) != crc:
            raise WireError("a message whose CRC is wrong")
        self.messages += 1
        return Fields(payload)

    def step(self):
        """Takes one message over; false after the farewell."""
        f, m = self.next(), self.mirror
        tag = f.varint(14)
        if tag == HELLO:
            version = f.varint()
            if version != VERSION:
                raise WireError(f"the other side speaks version {version}")
        elif tag == REFUSED:
            raise WireError(f"refused: {f.text()}")
        elif tag == SCENE:
            m.take_scene(f)
        elif tag == PIECE:
            m.take_piece(f)
        elif tag == POSE:
            m.poses += 1
            f.at = len(f.payload)
        elif tag == REMOVALS:
            for _ in range(f.varint(256)):
                f.varint(), f.varint(), f.varint(), f.u8()
                f.floats("d", 14)  # poses before and after
                m.removed_mm3 = sum(f.floats("d", 8))
        elif tag == BRICKS:
            m.take_bricks(f)
        elif tag == DIGEST:
            self.answer(f)
        elif tag == RESET:
            m.reset(f.varint())
        elif tag == UNDONE:
            m.epoch = f.varint()
            m.removed_mm3 = sum(f.floats("d", 8))
        elif tag == WELCOME:
            self.welcome = (f.varint(), f.varint())
            self.result["number"] = f.varint(65_535)
            self.result["granted"] = f.varint()
            self.result["resumed"] |= f.boolean()
        elif tag == CONTROL:
            f.option(), f.option()
            self.result["viewers"] = [
                (f.varint(), f.varint(2), f.boolean(), f.text(200))[3] for _ in range(f.varint(64))
            ]
        elif tag == BYE:
            self.result["bye"] = f.text()
            return False
        else:  # health, denied: not shown here
            f.at = len(f.payload)
        f.end()
        return True

    def answer(self, f):
        epoch, revision, asked, _ = f.varint(), f.varint(), f.varint(), f.varint()
        digest, changed = self.mirror.digest(epoch, revision)
        self.result.update(digest=f"{digest:016x}", equal=digest == asked, changed_chunks=changed)
        counters = (self.mirror.epoch, revision, digest, changed, 0, self.mirror.bricks, 1)
        self.send(bytes([2]) + b"".join(map(varint, counters)))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("socket", help="socket of the haptics process")
    parser.add_argument("--break-after", type=int, metavar="N", help="hang up after N messages and come back")
    args = parser.parse_args()
    viewer = Viewer(args.socket)
    began = time.monotonic()
    viewer.join()
    try:
        while viewer.step():
            if viewer.messages == args.break_after:
                viewer.stream.close()
                viewer.join()
            m = viewer.mirror
            if m.scene and "complete_s" not in viewer.result and len(m.coords) == m.scene["chunks"]:
                viewer.result["complete_s"] = round(time.monotonic() - began, 3)
    except (WireError, OSError) as problem:
        sys.exit(f"viewer.py: {problem}")
    m = viewer.mirror
    print(
        json.dumps(
            viewer.result
            | {
                "chunks": len(m.coords),
                "solid_mm3": m.solid_mm3(),
                "solid_mm3_told": m.scene["solid_mm3"],
                "bricks": m.bricks,
                "poses": m.poses,
                "removed_mm3": m.removed_mm3,
                "tools": m.scene["tools"],
            }
        )
    )
    return 0 if viewer.result.get("equal") else 1


if __name__ == "__main__":
    sys.exit(main())
