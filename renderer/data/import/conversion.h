/* SPDX-License-Identifier: Apache-2.0
 *
 * Converts numbers of a file that differ from the samples in memory: the volume does not support
 * their type, they are rescaled, or each sample has several components.
 *
 *   file                                  memory
 *   whole, 1 or 2 bytes; int32            the same
 *   uint32, int64, uint64                 float64; a warning if one is rounded (above 2^53)
 *   float16, float32                      float32
 *   float64                               float64
 *   complex numbers                       the magnitude in their floating-point type; a warning
 */
#ifndef SP_IMPORT_CONVERSION_H
#define SP_IMPORT_CONVERSION_H

#include "data/import/number.h"

enum { IMPORT_MISSING_MAX = 4 };

/* sample = slope · number + offset */
struct import_conversion {
    struct import_number number;    /* in the file */
    unsigned components, component; /* numbers per sample, and which of them is read */
    double slope, offset;
    enum sp_type type; /* in memory */
    /* Numbers of the file that stand for no sample become NaN. */
    unsigned missing_count;
    double missing[IMPORT_MISSING_MAX];
    bool has_range; /* numbers outside of this range also become NaN */
    double range[2];
    struct import_warnings *warnings; /* for warnings about lost data; NULL = no warnings */
};

/* Reads numbers of this kind as they are: slope 1, offset 0, one component. Warns of complex
 * numbers. */
struct import_conversion import_conversion_of(struct import_number number,
                                              struct import_warnings *warnings);

/* Chooses the type in memory for stored numbers in [low, high]. If all samples are whole, it is the
 * smallest type that holds them exactly, at least as large as that of the file where that serves;
 * otherwise float32 for numbers of at most 2 bytes, and float64 for larger integers or if an offset
 * is so large that float32 would lose the slope. */
void import_conversion_choose(struct import_conversion *conversion, double low, double high);

/* Adds a number that stands for no sample, unless there are too many. The type becomes one that has
 * NaN. */
void import_conversion_add_missing(struct import_conversion *conversion, double number);

/* Numbers outside of the range stand for no sample. */
void import_conversion_set_range(struct import_conversion *conversion, double low, double high);

/* True if memory holds the same numbers as the file, apart from the byte order. */
bool import_conversion_is_copy(const struct import_conversion *conversion);

/* Converts `count` samples in native byte order. A whole number outside the range of the type
 * becomes the nearest number in the range. */
void import_conversion_put(const struct import_conversion *conversion, const void *numbers,
                           size_t count, void *out);

#endif
