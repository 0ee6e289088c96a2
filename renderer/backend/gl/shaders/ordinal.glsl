// SPDX-License-Identifier: Apache-2.0
// Numbers as integers in the same order, for atomicMin() and atomicMax().

int ordinal(float x) {
    int bits = floatBitsToInt(x);
    return bits ^ (bits >> 31 & 0x7fffffff);
}

float from_ordinal(int x) {
    return intBitsToFloat(x ^ (x >> 31 & 0x7fffffff));
}
