"""JPEG and PNG data made by hand, to be attacked with: small files that are large images, and worse."""

import struct
import zlib

PNG_SIGNATURE = b'\x89PNG\r\n\x1a\n'
START, END = b'\xff\xd8', b'\xff\xd9'


# ---- PNG ----

def chunk(name, body=b''):
    return struct.pack('>I', len(body)) + name + body + struct.pack('>I', zlib.crc32(name + body))


def png(width, height, bits=8, colour=0, before=b'', pixels=None):
    """A black PNG; `before` are chunks between header and pixels, `pixels` replaces the compressed rows."""
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[colour]
    if pixels is None:
        compressor = zlib.compressobj(9)
        row = bytes(1 + -(-width * channels * bits // 8))
        pixels = b''.join(compressor.compress(row) for _ in range(height)) + compressor.flush()
    return (PNG_SIGNATURE + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, bits, colour, 0, 0, 0)) + before
            + chunk(b'IDAT', pixels) + chunk(b'IEND'))


def animated_png(region=(1, 1, 0, 10000)):
    """4 x 4 pixels, and a first frame (width, height, x, y) that lies outside: OpenCV 4.11 writes there."""
    def control(number, *region):
        return chunk(b'fcTL', struct.pack('>IIIIIHHBB', number, *region, 1, 10, 0, 0))

    return (PNG_SIGNATURE + chunk(b'IHDR', struct.pack('>IIBBBBB', 4, 4, 8, 6, 0, 0, 0))
            + chunk(b'acTL', struct.pack('>II', 2, 0)) + control(0, *region)
            + chunk(b'IDAT', zlib.compress(bytes((1 + 4 * 4) * 4))) + control(1, 4, 4, 0, 0)
            + chunk(b'fdAT', struct.pack('>I', 2) + zlib.compress(bytes(1000))) + chunk(b'IEND'))


# ---- JPEG ----

GREY, COLOUR, COLOUR_420 = (0x11,), (0x11, 0x11, 0x11), (0x22, 0x11, 0x11)


def segment(marker, body):
    return struct.pack('>BBH', 0xFF, marker, len(body) + 2) + body


def tables(ac_symbol=0):
    """Quantisation by one; of the Huffman codes only `0`, for DC difference 0 and for one symbol of AC."""
    one_code = bytes([1] + [0] * 15)
    return (segment(0xDB, b'\0' + bytes([1]) * 64) + segment(0xC4, b'\x00' + one_code + b'\0')
            + segment(0xC4, b'\x10' + one_code + bytes([ac_symbol])))


def frame(width, height, components=GREY, marker=0xC0, bits=8):
    return segment(marker, struct.pack('>BHHB', bits, height, width, len(components))
                   + b''.join(bytes([number, sampling, 0]) for number, sampling in enumerate(components, 1)))


def scan(components, first=0, last=63, approximation=0):
    return segment(0xDA, bytes([len(components)]) + b''.join(bytes([number, 0]) for number in components)
                   + bytes([first, last, approximation]))


def blocks(width, height, components):
    if len(components) == 1:
        return -(-width // 8) * -(-height // 8)
    across, down = (max(sampling >> 4 for sampling in components), max(sampling & 15 for sampling in components))
    units = -(-width // (8 * across)) * -(-height // (8 * down))
    return units * sum((sampling >> 4) * (sampling & 15) for sampling in components)


def flat_jpeg(width, height, components=GREY, before=b''):
    """Mid-grey, of two bits for each block; `before` comes first of all."""
    size = -(-blocks(width, height, components) // 4)
    return (START + before + tables() + frame(width, height, components) + scan(range(1, len(components) + 1))
            + bytes(size) + END)


def progressive_jpeg(width, height, scans, components=GREY):
    """Mid-grey again and again: one scan of DC, all others say that there is no AC."""
    count = len(components)
    across, down = -(-width // 8), -(-height // 8)
    nothing = bytes(-(-15 * -(-across * down // 16384) // 8))   # runs of 16384 blocks, in 15 bits each
    return (START + tables(0xE0) + frame(width, height, components, 0xC2)
            + scan(range(1, count + 1), 0, 0) + bytes(-(-blocks(width, height, components) // 8))
            + (scan([1], 1, 63) + nothing) * (scans - 1) + END)
