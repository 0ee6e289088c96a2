/* SPDX-License-Identifier: Apache-2.0 */
#include "data/import/axes.h"

#include <string.h>
#include <strings.h>

#include "data/import/meaning.h"

enum {
    COLORS_MIN = 3,
    COLORS_MAX = 4,
    PARTS_MIN = 2,
    PARTS_MAX = 4,
    TENSOR_MAX = 9,
    IMAGE_MIN = 16
};

void import_axes_place(struct import_axes *axes, const int *space, unsigned count,
                       const char *const *names) {
    int named[3] = { -1, -1, -1 };
    unsigned found = 0;
    for (unsigned i = 0; i < count; i++)
        for (int a = 0; a < 3; a++) {
            const char *const letter = (const char *const[]){ "x", "y", "z" }[a];
            if (named[a] < 0 && names[space[i]] && strcasecmp(names[space[i]], letter) == 0) {
                named[a] = space[i];
                found++;
            }
        }
    for (unsigned i = 0; i < 3; i++)
        axes->space[i] = found == count ? named[i] : i < count ? space[count - 1 - i] : -1;
}

bool import_axes_is_one_of(const char *name, const char *const *names) {
    for (; *names; names++)
        if (strcasecmp(name, *names) == 0)
            return true;
    return false;
}

static const char *const times[] = { "t", "time", "times", "step", NULL };

bool import_axes_is_channel(const char *name) {
    static const char *const channels[] = { "c",      "ch",          "channel",   "channels",
                                            "band",   "bands",       "component", "components",
                                            "rgb",    "rgba",        "member",    "ensemble",
                                            "number", "realization", NULL };
    return import_axes_is_one_of(name, channels);
}

/* True if the last dimension must hold channels: it is short, all dimensions of space are longer,
 * and the dimension in the usual place of channels is too long. An image in colours, and the 5 to 9
 * numbers of a tensor, count only if the others are much longer. */
static bool has_channels_last(unsigned rank, const uint64_t *shape) {
    const uint64_t parts = rank >= 3 && rank <= 5 ? shape[rank - 1] : 0;
    const unsigned first = rank == 5; /* behind the time */
    const bool is_doubtful = rank == 3 || parts > PARTS_MAX;
    bool has = parts >= (rank == 3 ? COLORS_MIN : PARTS_MIN) &&
               parts <= (rank == 3 ? PARTS_MAX : TENSOR_MAX) && shape[first] > PARTS_MAX;
    for (unsigned d = first; has && d < rank - 1; d++)
        has = shape[d] > (is_doubtful ? IMAGE_MIN : parts);
    return has;
}

/* Collects the dimensions of space in `space` and returns their number. */
static unsigned guess_named(struct import_axes *axes, unsigned rank, const char *const *names,
                            int *space) {
    unsigned count = 0;
    for (unsigned d = 0; d < rank; d++)
        if (import_axes_is_one_of(names[d], times) && axes->time < 0)
            axes->time = (int)d;
        else if (import_axes_is_channel(names[d]) && axes->channel < 0)
            axes->channel = (int)d;
        else
            space[count++] = (int)d;
    return count;
}

static unsigned guess_plain(struct import_axes *axes, unsigned rank, const uint64_t *shape,
                            bool are_bytes, int *space) {
    unsigned used = rank, count = 0; /* without the last ones of length 1 */
    while (used > 2 && shape[used - 1] == 1)
        used--;
    const unsigned last = used - 1;
    const bool has_few = has_channels_last(used, shape);
    axes->are_colors = are_bytes && (used == 4 || has_few) && shape[last] >= COLORS_MIN &&
                       shape[last] <= COLORS_MAX;
    const bool is_last = axes->are_colors || has_few;
    const bool has_one = rank == 5 && used == 4; /* t, z, y, x and one channel */
    for (unsigned d = 0; d < used; d++) {
        const unsigned behind = last - d; /* dimensions behind this one */
        if (behind == 4 || (has_one && !is_last && d == 0))
            axes->time = (int)d;
        else if (is_last ? d == last : behind == 3)
            axes->channel = (int)d;
        else if (count < IMPORT_RANK_MAX)
            space[count++] = (int)d;
    }
    return count;
}

bool import_axes_guess(struct import_axes *axes, unsigned rank, const uint64_t *shape,
                       const char *const *names, bool are_bytes) {
    int space[IMPORT_RANK_MAX];
    bool has_names = true;
    for (unsigned d = 0; d < rank; d++)
        has_names &= names[d] && *names[d];
    *axes = (struct import_axes){ .space = { -1, -1, -1 }, .channel = -1, .time = -1 };
    const unsigned count = has_names ? guess_named(axes, rank, names, space)
                                     : guess_plain(axes, rank, shape, are_bytes, space);
    if (count < 1 || count > 3)
        return false;
    import_axes_place(axes, space, count, names);
    return true;
}

bool import_axes_choose(struct import_axes *axes, const struct import_file *file,
                        const uint64_t *shape, struct import_header *header, struct sp_error *err) {
    const enum import_as wanted = file->selection.as;
    const bool has_both = axes->channel >= 0 && axes->time >= 0;
    int *const from = axes->channel >= 0 ? &axes->channel
                      : axes->time >= 0  ? &axes->time
                                         : &axes->space[2];
    const int dimension = *from;
    const struct import_extra extra = {
        .count = dimension < 0 ? 1 : shape[dimension],
        .meaning = dimension == axes->time ? IMPORT_AS_TIME
                   : axes->are_colors      ? IMPORT_AS_RGB
                                           : IMPORT_AS_CHANNELS,
        .are_parts = has_both,
    };
    enum import_as as;
    if (!import_as_is_axis(wanted))
        return true;
    if (!import_meaning_choose(file, &extra, header, &as, err))
        return false;
    *from = -1;
    *(as == IMPORT_AS_TIME ? &axes->time : &axes->channel) = dimension;
    axes->are_colors = as == IMPORT_AS_RGB;
    axes->are_vectors = as == IMPORT_AS_VECTORS;
    return true;
}
