/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/number.h"

#include <byteswap.h>
#include <math.h>
#include <string.h>

struct import_number import_number_of(enum sp_type type) {
    bool is_float = type == SP_FLOAT32 || type == SP_FLOAT64;
    bool is_unsigned = type == SP_UINT8 || type == SP_UINT16;
    return (struct import_number){ is_float      ? IMPORT_FLOAT
                                   : is_unsigned ? IMPORT_UNSIGNED
                                                 : IMPORT_SIGNED,
                                   sp_type_size(type) };
}

bool import_number_by_code(const struct import_number_entry *table, size_t count, int code,
                           struct import_number *number) {
    for (size_t i = 0; i < count; i++)
        if (table[i].code == code) {
            *number = table[i].number;
            return true;
        }
    return false;
}

bool import_number_by_name(const struct import_number_entry *table, size_t count, const char *name,
                           size_t length, struct import_number *number) {
    for (size_t i = 0; i < count; i++)
        if (strlen(table[i].name) == length && strncmp(table[i].name, name, length) == 0) {
            *number = table[i].number;
            return true;
        }
    return false;
}

bool import_number_named(const char *name, struct import_number *number) {
    static const struct import_number_entry known[] = {
        { "int8", 0, { IMPORT_SIGNED, 1 } },        { "uint8", 0, { IMPORT_UNSIGNED, 1 } },
        { "int16", 0, { IMPORT_SIGNED, 2 } },       { "uint16", 0, { IMPORT_UNSIGNED, 2 } },
        { "int32", 0, { IMPORT_SIGNED, 4 } },       { "uint32", 0, { IMPORT_UNSIGNED, 4 } },
        { "int64", 0, { IMPORT_SIGNED, 8 } },       { "uint64", 0, { IMPORT_UNSIGNED, 8 } },
        { "float16", 0, { IMPORT_FLOAT, 2 } },      { "float32", 0, { IMPORT_FLOAT, 4 } },
        { "float64", 0, { IMPORT_FLOAT, 8 } },      { "complex64", 0, { IMPORT_COMPLEX, 8 } },
        { "complex128", 0, { IMPORT_COMPLEX, 16 } }
    };
    return import_number_by_name(known, sizeof known / sizeof *known, name, strlen(name), number);
}

bool import_number_is_complex(struct import_number number) {
    return number.kind == IMPORT_COMPLEX || number.kind == IMPORT_COMPLEX_SIGNED;
}

bool import_number_is_whole(struct import_number number) {
    return number.kind == IMPORT_SIGNED || number.kind == IMPORT_UNSIGNED;
}

struct import_number import_number_part(struct import_number number) {
    if (number.kind == IMPORT_COMPLEX)
        return (struct import_number){ IMPORT_FLOAT, number.size / 2 };
    if (number.kind == IMPORT_COMPLEX_SIGNED)
        return (struct import_number){ IMPORT_SIGNED, number.size / 2 };
    return number;
}

void import_number_range(struct import_number number, double *low, double *high) {
    const double values = ldexp(1, 8 * (int)number.size);
    *low = number.kind == IMPORT_SIGNED ? -values / 2 : 0;
    *high = number.kind == IMPORT_SIGNED ? values / 2 - 1 : values - 1;
}

void import_swap(void *values, size_t size, uint64_t count) {
    switch (size) {
    case 2:
        for (uint16_t *p = values, *end = p + count; p < end; p++)
            *p = bswap_16(*p);
        break;
    case 4:
        for (uint32_t *p = values, *end = p + count; p < end; p++)
            *p = bswap_32(*p);
        break;
    case 8:
        for (uint64_t *p = values, *end = p + count; p < end; p++)
            *p = bswap_64(*p);
        break;
    }
}

void import_swap_numbers(void *numbers, struct import_number number, uint64_t count) {
    const size_t size = import_number_part(number).size;
    import_swap(numbers, size, count * (number.size / size));
}

double import_number_color_scale(struct import_number number) {
    return number.kind == IMPORT_FLOAT ? 1 : number.size == 1 ? 1 / 255.0 : 1 / 65535.0;
}

/* IEEE 754, 16 bits: a sign, 5 bits of exponent, 10 of fraction. */

static double from_half(uint16_t half) {
    const int exponent = half >> 10 & 31, fraction = half & 1023;
    const double sign = half >> 15 ? -1 : 1;
    if (exponent == 31)
        return fraction ? NAN : sign * INFINITY;
    return sign * (exponent ? ldexp(1024 + fraction, exponent - 25) : ldexp((double)fraction, -24));
}

static uint16_t to_half(double value) {
    const uint16_t sign = signbit(value) ? 0x8000 : 0;
    const double size = fabs(value);
    int exponent;
    if (isnan(value))
        return 0x7e00;
    if (size >= 65520) /* rounds to 65536, which is too large */
        return sign | 0x7c00;
    if (size < 0x1p-25) /* rounds to 0 */
        return sign;
    frexp(size, &exponent); /* size is in [2^(exponent - 1), 2^exponent) */
    exponent = exponent < -13 ? -14 : exponent - 1;
    /* The fraction has the leading 1 of a normal number, which adds 1 to the exponent. */
    return (uint16_t)(sign | (((exponent + 14) << 10) + (int)rint(ldexp(size, 10 - exponent))));
}

#define WIDEN(T)                                                                                   \
    for (size_t i = 0; i < count; i++, at += stride) {                                             \
        T value;                                                                                   \
        memcpy(&value, at, sizeof value);                                                          \
        out[i] = (double)value;                                                                    \
    }                                                                                              \
    break

static void widen_floats(const char *at, size_t size, size_t stride, size_t count, double *out) {
    switch (size) {
    case 2:
        for (size_t i = 0; i < count; i++, at += stride) {
            uint16_t half;
            memcpy(&half, at, sizeof half);
            out[i] = from_half(half);
        }
        break;
    case 4:
        WIDEN(float);
    default:
        WIDEN(double);
    }
}

static void widen_signed(const char *at, size_t size, size_t stride, size_t count, double *out) {
    switch (size) {
    case 1:
        WIDEN(int8_t);
    case 2:
        WIDEN(int16_t);
    case 4:
        WIDEN(int32_t);
    default:
        WIDEN(int64_t);
    }
}

static void widen_unsigned(const char *at, size_t size, size_t stride, size_t count, double *out) {
    switch (size) {
    case 1:
        WIDEN(uint8_t);
    case 2:
        WIDEN(uint16_t);
    case 4:
        WIDEN(uint32_t);
    default:
        WIDEN(uint64_t);
    }
}

static void widen_complex(const char *at, struct import_number part, size_t stride, size_t count,
                          double *out) {
    for (size_t i = 0; i < count; i++, at += stride)
        out[i] = hypot(import_widen(at, part), import_widen(at + part.size, part));
}

void import_widen_all(const void *numbers, struct import_number number, size_t stride, size_t count,
                      double *out) {
    switch (number.kind) {
    case IMPORT_SIGNED:
        widen_signed(numbers, number.size, stride, count, out);
        break;
    case IMPORT_UNSIGNED:
        widen_unsigned(numbers, number.size, stride, count, out);
        break;
    case IMPORT_FLOAT:
        widen_floats(numbers, number.size, stride, count, out);
        break;
    case IMPORT_COMPLEX:
    case IMPORT_COMPLEX_SIGNED:
        widen_complex(numbers, import_number_part(number), stride, count, out);
        break;
    }
}

double import_widen(const void *value, struct import_number number) {
    double out;
    import_widen_all(value, number, 0, 1, &out);
    return out;
}

double import_widen_big(const void *value, struct import_number number) {
    char own[2 * sizeof(double)];
    memcpy(own, value, number.size);
    if (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__)
        import_swap_numbers(own, number, 1);
    return import_widen(own, number);
}

static void narrow_part(double value, struct import_number part, void *out) {
    if (part.kind == IMPORT_FLOAT && part.size == 2) {
        const uint16_t half = to_half(value);
        memcpy(out, &half, sizeof half);
    } else if (part.kind == IMPORT_FLOAT && part.size == 4) {
        const float narrow = (float)value;
        memcpy(out, &narrow, sizeof narrow);
    } else if (part.kind == IMPORT_FLOAT) {
        memcpy(out, &value, sizeof value);
    } else {
        const uint64_t whole =
            part.kind == IMPORT_SIGNED ? (uint64_t)(int64_t)value : (uint64_t)value;
        const char *bytes = (const char *)&whole;
        if (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__)
            bytes += sizeof whole - part.size;
        memcpy(out, bytes, part.size);
    }
}

void import_narrow(double value, struct import_number number, void *out) {
    const struct import_number part = import_number_part(number);
    memset(out, 0, number.size);
    narrow_part(value, part, out);
}

struct import_number import_bits_number(unsigned bits) {
    return (struct import_number){ IMPORT_UNSIGNED, bits <= 8 ? 1 : bits <= 16 ? 2 : 4 };
}

void import_bits_unpack(const uint8_t *packed, unsigned bits, bool is_high_first, uint64_t first,
                        size_t count, void *out) {
    const size_t size = import_bits_number(bits).size;
    uint64_t at = first * bits;
    for (size_t i = 0; i < count; i++) {
        uint32_t value = 0;
        for (unsigned bit = 0; bit < bits; bit++, at++) {
            const unsigned in_byte = (unsigned)(at & 7);
            if (is_high_first)
                value = value << 1 | (packed[at >> 3] >> (7 - in_byte) & 1);
            else
                value |= (uint32_t)(packed[at >> 3] >> in_byte & 1) << bit;
        }
        if (size == 1)
            ((uint8_t *)out)[i] = (uint8_t)value;
        else if (size == 2)
            ((uint16_t *)out)[i] = (uint16_t)value;
        else
            ((uint32_t *)out)[i] = value;
    }
}
