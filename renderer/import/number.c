/* SPDX-License-Identifier: Apache-2.0 */
#include "import/number.h"

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

double import_widen(const void *value, struct import_number number) {
    union {
        uint8_t u8;
        uint16_t u16;
        uint32_t u32;
        uint64_t u64;
        float f;
        double d;
    } v;
    memcpy(&v, value, number.size);
    if (number.kind == IMPORT_FLOAT)
        return number.size == 4 ? (double)v.f : v.d;
    bool is_signed = number.kind == IMPORT_SIGNED;
    switch (number.size) {
    case 1:
        return is_signed ? (int8_t)v.u8 : v.u8;
    case 2:
        return is_signed ? (int16_t)v.u16 : v.u16;
    case 4:
        return is_signed ? (int32_t)v.u32 : (double)v.u32;
    default:
        return is_signed ? (double)(int64_t)v.u64 : (double)v.u64;
    }
}
