/* SPDX-License-Identifier: Apache-2.0
 *
 * The header and the index of a brick file (README.md). Numbers are little-endian.
 *
 *   header      BRICK_HEADER_BYTES: grid, type, statistics; offsets and checksums of other parts
 *   bricks      packed by zstd, each with its own checksum; constant bricks have no bytes
 *   vectors     the same: three float32 per sample; bricks of zeros have no bytes; may be missing
 *   axes        a float64 per sample of each rectilinear axis: its distance from sample 0
 *   notes       names of other fields and vectors, time steps, warnings; may be missing
 *   indices     per level, an entry per brick, i0 fastest: one of samples, and one of vectors
 */
#ifndef SP_BRICKS_FORMAT_H
#define SP_BRICKS_FORMAT_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/volume.h"

enum {
    BRICK_SIDE = 64,  /* samples per axis; fewer at the far ends of a level */
    BRICK_MARGIN = 4, /* samples around a brick that its range includes */
    BRICK_LEVELS_MAX = 16,
    BRICK_MAGIC_BYTES = 8,
    BRICK_HEADER_BYTES = 4096,
    BRICK_ENTRY_BYTES = 32
};

extern const char sp_brick_magic[BRICK_MAGIC_BYTES]; /* the first bytes of the file */

/* In a file, level n + 1 has the means of 2 × 2 × 2 samples of level n (draw/resample/levels.h);
 * the last one is one brick. Levels from elsewhere (chunks.h) have any steps. */
struct sp_brick_entry {
    uint64_t at;     /* of the packed samples in the file; constant: its sample, zero-extended */
    uint32_t bytes;  /* packed; 0 = all samples are equal */
    uint32_t check;  /* the checksum of the samples at the end of the packed bytes; constant: 0 */
    double range[2]; /* of the finite samples, with the margin; [0] > [1] = there are none; of
                        vectors: 0 */
};

/* Where an index is in the file. */
struct sp_brick_index {
    uint64_t at;
    uint64_t checksum; /* of the index, and so of the samples */
};

struct sp_brick_level {
    uint32_t dims[3];   /* samples */
    uint32_t bricks[3]; /* dims / BRICK_SIDE, rounded up */
    /* Sample i lies at offset + step·i along an axis [samples of level 0]: in a file, at the centre
     * of the samples that it stands for. */
    double step[3], offset[3];
    /* Of a rectilinear axis: the distance of each sample from sample 0, and of that one from sample
     * 0 of level 0 [world unit]. Places of coarser levels are means, as samples are. NULL = the
     * axis is even. (places.h) */
    const double *places[3];
    double start[3];
    struct sp_brick_index samples, vectors; /* vectors: all 0 if there are none */
};

struct sp_brick_header {
    /* Of level 0: grid, type, meaning, unit, names, anatomy, range, nonfinite, histogram,
     * projected, longest, components, voxel_bytes and vector_bytes; of the notes: others,
     * other_vectors, steps and warnings; everything else is 0. The grid has its coordinates after
     * sp_brick_places_fill(). */
    struct sp_volume_info info;
    uint32_t rectilinear;                           /* bit a: axis a */
    uint64_t axes_at, axes_checksum;                /* in the file; 0 = there are none */
    uint64_t notes_at, notes_bytes, notes_checksum; /* the same */
    unsigned levels;
    struct sp_brick_level level[BRICK_LEVELS_MAX];
};

static inline uint64_t sp_brick_count(const struct sp_brick_level *level) {
    return (uint64_t)level->bricks[0] * level->bricks[1] * level->bricks[2];
}

/* Computes the first sample and the size of brick `number` of a level. */
void sp_brick_box(const struct sp_brick_level *level, uint64_t number, uint32_t first[3],
                  uint32_t size[3]);

/* Fills levels and the sizes of each from the grid. */
void sp_brick_header_init(struct sp_brick_header *header);

/* Fills `bricks` from `dims`. */
void sp_brick_level_divide(struct sp_brick_level *level);

/* Returns how much wider a sample of the level is than a sample of level 0: log2 of the mean over
 * the axes. */
double sp_brick_level_width(const struct sp_brick_level *level);

/* Finds the bricks of the level `to` that cover bricks [first, first + count) of the level `from`:
 * `first` and `count` along one axis. */
void sp_brick_level_map(const struct sp_brick_level *from, const struct sp_brick_level *to,
                        int axis, uint32_t *first, uint32_t *count);

/* FNV-1a, 64 bits. */
uint64_t sp_brick_checksum(const void *bytes, size_t size);

/* Encodes the header and its checksum. */
void sp_brick_header_encode(const struct sp_brick_header *header,
                            unsigned char out[BRICK_HEADER_BYTES]);

/* Decodes and checks every field against the size of the file. SP_ERR_FORMAT, SP_ERR_UNSUPPORTED
 * (version) with `title` as the place. */
bool sp_brick_header_decode(const unsigned char bytes[BRICK_HEADER_BYTES], uint64_t file_bytes,
                            const char *title, struct sp_brick_header *header,
                            struct sp_error *err);

enum {
    BRICK_NOTES_BYTES = 3 * 4 + SP_UNIT_BYTES +
                        (SP_OTHER_FIELDS_MAX + SP_OTHER_VECTORS_MAX) * SP_FIELD_BYTES +
                        SP_WARNINGS_MAX * SP_WARNING_BYTES /* and 8 per time step */
};
/* Size of the notes of a volume. */
size_t sp_brick_notes_bytes(const struct sp_volume_info *info);
/* Encodes the notes, with the times if they are known. */
void sp_brick_notes_encode(const struct sp_volume_info *info, unsigned char *out);
/* Decodes them into *info; the bytes stay. The times go to `times`, for which there is space for
 * one number per 8 bytes, and which info->steps names if they are known. SP_ERR_FORMAT. */
bool sp_brick_notes_decode(unsigned char *bytes, size_t size, const char *title,
                           struct sp_volume_info *info, double *times, struct sp_error *err);

void sp_brick_entry_encode(const struct sp_brick_entry *entry,
                           unsigned char out[BRICK_ENTRY_BYTES]);
/* SP_ERR_FORMAT if the samples do not lie in the file. */
bool sp_brick_entry_decode(const unsigned char bytes[BRICK_ENTRY_BYTES], uint64_t file_bytes,
                           const char *title, struct sp_brick_entry *entry, struct sp_error *err);

enum {
    BRICK_VECTOR_BYTES = 3 * sizeof(float),
    /* Most bytes that a packed brick may have, of samples or vectors. */
    BRICK_PACKED_MAX = BRICK_SIDE * BRICK_SIDE * BRICK_SIDE * BRICK_VECTOR_BYTES + (1 << 16)
};

/* Returns the bytes of a sample; if there are vectors, the bytes of a sample or a vector, whichever
 * is larger. */
static inline size_t sp_brick_item_max(const struct sp_volume_info *info) {
    const size_t sample = sp_type_size(info->type);
    return info->vector_bytes && sample < BRICK_VECTOR_BYTES ? BRICK_VECTOR_BYTES : sample;
}

#endif
