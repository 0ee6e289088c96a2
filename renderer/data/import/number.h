/* SPDX-License-Identifier: Apache-2.0
 *
 * Single numbers as files store them. Every reader leaves the types of its numbers to this file and
 * to conversion.h, so that all formats know the same ones.
 */
#ifndef SP_IMPORT_NUMBER_H
#define SP_IMPORT_NUMBER_H

#include "data/import/format.h"

enum { IMPORT_NUMBER_BYTES = 16 }; /* of the largest number */

struct import_number import_number_of(enum sp_type type);

/* The code or the name of a type of number in a format. */
struct import_number_entry {
    const char *name;
    int code;
    struct import_number number;
};

/* Finds a number of a table by its code, or by its name of `length` bytes. False if it is not
 * there. */
bool import_number_by_code(const struct import_number_entry *table, size_t count, int code,
                           struct import_number *number);
bool import_number_by_name(const struct import_number_entry *table, size_t count, const char *name,
                           size_t length, struct import_number *number);

/* Finds the kind of a number by its name: "int8" to "int64", "uint8" to "uint64", "float16",
 * "float32", "float64", "complex64", "complex128". */
bool import_number_named(const char *name, struct import_number *number);

/* The part of a complex number; another number is its own part. Parts have a byte order, and stand
 * for themselves where a number is copied. */
struct import_number import_number_part(struct import_number number);

bool import_number_is_complex(struct import_number number);

/* True for the kinds whose numbers have no fractions. */
bool import_number_is_whole(struct import_number number);

/* Converts a number in native byte order, which need not be aligned. Of a complex number it returns
 * the magnitude. */
double import_widen(const void *value, struct import_number number);

/* The same of a number in big-endian order, at any address. */
double import_widen_big(const void *value, struct import_number number);

/* Converts `count` numbers that lie `stride` bytes apart. */
void import_widen_all(const void *numbers, struct import_number number, size_t stride, size_t count,
                      double *out);

/* The reverse of import_widen(). The imaginary part is 0. A whole number must be in the range. */
void import_narrow(double value, struct import_number number, void *out);

/* Reverses the bytes of `count` values of 1, 2, 4 or 8 bytes each (`size`). Of complex numbers
 * these are the parts: import_swap_numbers() does that for any kind. */
void import_swap(void *values, size_t size, uint64_t count);
void import_swap_numbers(void *numbers, struct import_number number, uint64_t count);

/* The smallest and largest number of a kind. A floating-point kind gives the range of integers of
 * its size. */
void import_number_range(struct import_number number, double *low, double *high);

/* The factor that brings the part of a colour, such as its red, into [0, 1]. */
double import_number_color_scale(struct import_number number);

/* Numbers of 1 to 32 bits without a sign that fill bytes without gaps. */

/* What they become: whole numbers of 1, 2 or 4 bytes. */
struct import_number import_bits_number(unsigned bits);

/* Unpacks `count` numbers from number `first` on. `is_high_first`: the first number lies in the
 * highest bits of its byte, as in TIFF and VTK; else in the lowest ones, as in DICOM. */
void import_bits_unpack(const uint8_t *packed, unsigned bits, bool is_high_first, uint64_t first,
                        size_t count, void *out);

#endif
