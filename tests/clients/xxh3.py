"""XXH3-64 with seed 0, after the published description of the algorithm; the standard library has none."""

import struct

M = (1 << 64) - 1
P32 = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
P64 = (
    0x9E3779B185EBCA87,
    0xC2B2AE3D27D4EB4F,
    0x165667B19E3779F9,
    0x85EBCA77C2B2AE63,
    0x27D4EB2F165667C5,
)
SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671f"
    "cb79e64eccc0e578825ad07dccff7221b8084674f743248ee03590e6813a264c"
    "3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364"
    "eac5ac8334d3ebc3c581a0fffa1363eb170ddd51b7f0da49d316552629d4689e"
    "2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)


def u64(data, at):
    return int.from_bytes(data[at : at + 8], "little")


def fold(a, b):
    product = a * b
    return (product & M) ^ (product >> 64)


def avalanche(h):
    h ^= h >> 37
    h = h * 0x165667919E3779F9 & M
    return h ^ h >> 32


def mix16(data, at, key):
    return fold(u64(data, at) ^ u64(SECRET, key), u64(data, at + 8) ^ u64(SECRET, key + 8))


def short(data):
    n = len(data)
    if not 9 <= n <= 16:
        raise ValueError("no message of this protocol hashes fewer than 9 bytes")
    low = u64(data, 0) ^ u64(SECRET, 24) ^ u64(SECRET, 32)
    high = u64(data, n - 8) ^ u64(SECRET, 40) ^ u64(SECRET, 48)
    swapped = int.from_bytes(low.to_bytes(8, "little"), "big")
    return avalanche((n + swapped + high + fold(low, high)) & M)


def middle(data):
    n = len(data)
    h = n * P64[0]
    if n <= 128:
        for i in range((n - 1) // 32, -1, -1):
            h += mix16(data, 16 * i, 32 * i) + mix16(data, n - 16 * (i + 1), 32 * i + 16)
        return avalanche(h & M)
    for i in range(8):
        h += mix16(data, 16 * i, 16 * i)
    h = avalanche(h & M)
    for i in range(8, n // 16):
        h += mix16(data, 16 * i, 16 * (i - 8) + 3)
    return avalanche((h + mix16(data, n - 16, 136 - 17)) & M)


def accumulate(acc, stripe, key):
    for i in range(8):
        value = stripe[i]
        keyed = value ^ key[i]
        acc[i ^ 1] = acc[i ^ 1] + value & M
        acc[i] = acc[i] + (keyed & 0xFFFFFFFF) * (keyed >> 32) & M


def long(data):
    n = len(data)
    acc = [P32[2], P64[0], P64[1], P64[2], P64[3], P32[1], P64[4], P32[0]]
    keys = [struct.unpack_from("<8Q", SECRET, 8 * i) for i in range(17)]
    full = (n - 1) // 64
    for number in range(full):
        accumulate(acc, struct.unpack_from("<8Q", data, 64 * number), keys[number % 16])
        if number % 16 == 15:
            key = keys[16]
            for i in range(8):
                acc[i] = ((acc[i] ^ acc[i] >> 47) ^ key[i]) * P32[0] & M
    accumulate(acc, struct.unpack_from("<8Q", data, n - 64), struct.unpack_from("<8Q", SECRET, 121))
    h = n * P64[0]
    for i in range(4):
        key = 11 + 16 * i
        h += fold(acc[2 * i] ^ u64(SECRET, key), acc[2 * i + 1] ^ u64(SECRET, key + 8))
    return avalanche(h & M)


def xxh3_64(data):
    if len(data) <= 16:
        return short(data)
    return middle(data) if len(data) <= 240 else long(data)
