"""Encodes the PNG images of datasets.

In images with camera noise LZ77 finds no repeats. So the content is Huffman codes (RFC 1951) of
each row's differences from the mean of left and above, as of zlib's Z_HUFFMAN_ONLY, in one block.
"""

from functools import partial

import numpy as np

from t2twin.core.images import png_of
from t2twin.core.jit import compiled

SYMBOLS, LONGEST, WORD = 257, 15, np.uint64(32)  # bytes and the end; bits of a code, of a word
# Header of a last block with codes of its own and no distances, whose code lengths have 4 bits.
BLOCK, BLOCK_BITS = 0b101 | 15 << 13 | sum(4 << 26 + 3 * n for n in range(16)), 74
BACKWARDS = np.array([int(f"{n:04b}"[::-1], 2) for n in range(16)], np.uint8)
HEAD_BYTES, LEFT_BITS = divmod(BLOCK_BITS + 4 * (SYMBOLS + 1), 8)


def _deflate(values: np.ndarray) -> bytes:
    """One block of Huffman codes of uint8 values."""
    codes, lengths = np.zeros((2, SYMBOLS + 1), np.uint64)
    _assign(values, codes, lengths)
    nibbles = BACKWARDS[lengths]
    packed = int.from_bytes((nibbles[::2] | nibbles[1::2] << 4).tobytes(), "little")
    head = (BLOCK | packed << BLOCK_BITS).to_bytes(HEAD_BYTES + 1, "little")
    words = np.empty(values.size // 2 + 2, np.uint32)  # LONGEST is less than 16
    size = _pack(values, codes, lengths, head[-1], LEFT_BITS, words)
    return head[:-1] + words.view(np.uint8)[:size].tobytes()


encode_png = partial(png_of, deflate=_deflate)


@compiled(nogil=True)
def _assign(values, codes, lengths):
    """Fill in the Huffman codes, last bit first, and lengths, limited by raising counts."""
    counts, least, order = np.ones(SYMBOLS, np.int64), 1, np.arange(SYMBOLS)
    weights, parents, depths = np.full((3, 2 * SYMBOLS - 1), LONGEST + 1)
    for value in values:
        counts[value] += 1
    for n in range(SYMBOLS):  # by rising counts
        while n > 0 and counts[order[n - 1]] > counts[order[n]]:
            order[n - 1], order[n], n = order[n], order[n - 1], n - 1
    while depths[0] > LONGEST:
        leaf, node = 0, SYMBOLS  # the least of those that have no parent
        for n in range(SYMBOLS):
            weights[n] = max(counts[order[n]], least)
        for parent in range(SYMBOLS, weights.size):
            weights[parent] = 0
            for _ in range(2):
                child = node
                if leaf < SYMBOLS and (node == parent or weights[leaf] <= weights[node]):
                    child, leaf = leaf, leaf + 1
                else:
                    node += 1
                weights[parent] += weights[child]
                parents[child] = parent
        depths[-1], least = 0, 2 * least
        for n in range(weights.size - 2, -1, -1):
            depths[n] = depths[parents[n]] + 1
    code = 0
    for length in range(1, LONGEST + 1):
        code <<= 1
        for n in range(SYMBOLS):
            if depths[n] == length:
                lengths[order[n]] = length
        for symbol in range(SYMBOLS):
            if lengths[symbol] == length:
                for bit in range(length):
                    codes[symbol] |= np.uint64((code >> bit & 1) << (length - 1 - bit))
                code += 1


@compiled(nogil=True)
def _pack(values, codes, lengths, first, bits, words):
    """Fill words with the first bits, the codes of the values and of the end; returns the bytes."""
    waiting, bits, place = np.uint64(first), np.uint64(bits), 0
    for n in range(values.size + 1):
        symbol = values[n] if n < values.size else SYMBOLS - 1
        waiting |= codes[symbol] << bits
        bits += lengths[symbol]
        if bits >= WORD:
            words[place] = np.uint32(waiting)
            waiting, bits, place = waiting >> WORD, bits - WORD, place + 1
    words[place] = np.uint32(waiting)
    return 4 * place + (int(bits) + 7) // 8
