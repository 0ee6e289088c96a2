/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds which dimensions of an array are x, y, z, channels and time.
 */
#ifndef SP_IMPORT_AXES_H
#define SP_IMPORT_AXES_H

#include "data/import/format.h"

enum { IMPORT_RANK_MAX = 8 };

struct import_axes {
    int space[3];      /* the dimensions of x, y and z; −1 = none */
    int channel, time; /* −1 = none */
    bool are_colors;   /* the channels are red, green, blue and maybe alpha */
    bool are_vectors;  /* the channels are x, y and z of vectors */
};

/* Compares without regard to case; the list ends with NULL. */
bool import_axes_is_one_of(const char *name, const char *const *names);

/* True for names such as "c", "channel" and "band". */
bool import_axes_is_channel(const char *name);

/* Guesses from the names of the dimensions: "c", "channel", … and "t", "time", …; others are space.
 * Without a name for each (NULL or "") they are t, c, z, y, x, of which the first may be missing;
 * an array of bytes with four dimensions, the last of length 3 or 4, has colours there. Two to nine
 * entries of the last dimension are channels if the others are longer, and five or more are in the
 * place of channels; so are three or four of a plane of more than 16 by 16. Behind two dimensions
 * or more, the last ones of length 1 play no part; of five dimensions with one of them, the first
 * is time. False if more than three dimensions are left for space; *axes is not valid then. */
bool import_axes_guess(struct import_axes *axes, unsigned rank, const uint64_t *shape,
                       const char *const *names, bool are_bytes);

/* Assigns dimensions to z, y and x in this order, unless they are named so. `space` has `count` of
 * them, in [1, 3]. */
void import_axes_place(struct import_axes *axes, const int *space, unsigned count,
                       const char *const *names);

/* Applies "?as=" of the source: the entries of the dimension of channels, or of time, or without
 * both of the slowest dimension of space, are steps, channels, colours or components of vectors.
 * Without a choice nothing changes.
 */
bool import_axes_choose(struct import_axes *axes, const struct import_file *file,
                        const uint64_t *shape, struct import_header *header, struct sp_error *err);

#endif
