/* SPDX-License-Identifier: Apache-2.0
 *
 * The messages between the child process `splat-import` and its parent, over a socket that keeps
 * message boundaries. The samples, followed by the vectors if there are any and by the coordinates
 * of rectilinear axes, or else the elements (data/volume/elements.h), and the times of a series,
 * pass through a memfd. The parent sizes and seals it, so the child cannot lie about its size:
 *
 *   parent                                child
 *     socket, empty memfd, file ───────────►  reads the file's header
 *     progress()                      ◄────  OPENING …
 *     checks every field, reserve()   ◄────  HEADER   (or ERROR)
 *     sizes and seals the memfd      GO ───►  maps it, copies coordinates, reads, swaps bytes
 *     progress()                      ◄────  PROGRESS …
 *     waits for its end, maps,        ◄────  DONE     (or ERROR)
 *     checks coordinates
 *
 * For a volume that is shown from its chunks (pyramid.h), the memfd holds one chunk at a time:
 *
 *     checks every field              ◄────  HEADER, LEVELS   (or ERROR)
 *     sizes and seals the memfd      GO ───►  maps it
 *     asks for a chunk             READ ───►  reads it into the memfd
 *     copies the samples              ◄────  CHUNK    (or ERROR, of this chunk alone)
 *     …
 *
 * For a list of the series of a folder (listing.c), the memfd stays empty:
 *
 *     checks every field              ◄────  SERIES …, DONE   (or ERROR)
 *
 * A closed socket tells the child to stop. The parent trusts no message, because a hostile file may
 * have taken control of the child.
 */
#ifndef SP_IMPORT_HANDOVER_H
#define SP_IMPORT_HANDOVER_H

#include "data/bricks/chunks.h"
#include "sp/series.h"

enum {
    SP_HANDOVER_MAGIC = 0x49505331, /* "1SPI" in memory, little endian */
    SP_HANDOVER_VERSION = 15,
};

enum sp_handover_kind {
    SP_HANDOVER_HEADER = 1,
    SP_HANDOVER_PROGRESS,
    SP_HANDOVER_DONE,
    SP_HANDOVER_ERROR,
    SP_HANDOVER_GO,
    SP_HANDOVER_LEVELS,
    SP_HANDOVER_READ,
    SP_HANDOVER_CHUNK,
    SP_HANDOVER_OPENING,
    SP_HANDOVER_SERIES,
};

/* Levels of detail in chunks. Level 0 is the level that HEADER describes. */
struct sp_handover_levels {
    uint32_t count;
    struct sp_chunk_level level[BRICK_LEVELS_MAX];
};

/* The chunk that the parent asks for. */
struct sp_handover_read {
    uint32_t level, place[3];
};

struct sp_handover_header {
    uint32_t type; /* enum sp_type */
    uint32_t dims[3];
    uint32_t rectilinear;        /* bit a: dims[a] coordinates of axis a follow the samples */
    uint32_t has_vectors;        /* 0 or 1: three float32 per sample follow the samples; of points
                                    they are elements */
    uint32_t level, level_count; /* level of detail that is read, and the number of levels; both 0
                                    if there is only one */
    char anatomy[4];             /* as in struct sp_volume_info */
    uint32_t meaning;            /* enum sp_meaning */
    uint32_t steps, step;        /* struct sp_steps */
    uint32_t has_times;          /* 0 or 1: `steps` float64 follow everything else */
    uint32_t kind, count, vertex_count, degree; /* struct sp_elements_shape; of elements the grid is
                                                   one float32 sample */
    uint32_t lacks_colors;                      /* 0 or 1: the same */
    double spacing[3], origin[3], direction[3][3]; /* as in struct sp_grid */
    uint64_t bytes;                                /* product(dims) · size of the type */
    struct sp_vertical vertical;                   /* its unit is printable and ends with 0 */
    char unit[SP_UNIT_BYTES];                      /* printable, ends with 0 */
    char value_name[SP_FIELD_BYTES], vector_name[SP_FIELD_BYTES]; /* the same */
    char value_unit[SP_UNIT_BYTES], time_unit[SP_UNIT_BYTES];     /* the same */
    char others[SP_OTHER_FIELDS_MAX][SP_FIELD_BYTES];             /* the same */
    char other_vectors[SP_OTHER_VECTORS_MAX][SP_FIELD_BYTES];     /* the same */
};

struct sp_handover_done {
    uint64_t folded;                                  /* as in struct sp_volume_info */
    char warnings[SP_WARNINGS_MAX][SP_WARNING_BYTES]; /* the same; each ends with 0, and none
                                                         follows an empty one */
};

struct sp_handover_error {
    uint32_t code; /* enum sp_code, one that a reader may give */
    char place[SP_ERROR_PLACE], text[SP_ERROR_TEXT];
};

/* Both ends run on one machine and come from one build: native byte order, no meaningful padding.
 */
struct sp_handover {
    uint32_t magic;
    uint16_t version, kind;
    union {
        struct sp_handover_header header;
        /* PROGRESS: bytes of the memfd that are filled so far; GO: size of the memfd */
        uint64_t bytes;
        double share; /* OPENING: fraction of the file that is read so far, [0, 1] */
        struct sp_handover_done done;
        struct sp_handover_error error;
        struct sp_handover_levels levels;
        struct sp_handover_read read; /* READ: the requested chunk; CHUNK: the same values */
        struct sp_series series;
    };
};

/* Returns the size of a message of this kind in bytes; 0 for an unknown kind. */
size_t sp_handover_size(enum sp_handover_kind kind);

/* Initializes a message of this kind; all other fields are zero. */
void sp_handover_init(struct sp_handover *message, enum sp_handover_kind kind);

/* The layout of the memfd, in bytes from its start. */
struct sp_handover_layout {
    uint64_t vectors_at;        /* a multiple of 64; 0 = none */
    uint64_t coordinates_at[3]; /* multiples of 8; 0 for an even axis */
    uint64_t times_at;          /* a multiple of 8; 0 = unknown */
    uint64_t bytes;             /* of all */
};

/* Returns the shape of the elements of the file. The header must have been checked. */
struct sp_elements_shape sp_handover_shape(const struct sp_handover_header *header);

/* Fills *info, except for the name, the source, and the data in the memfd. Both messages must have
 * been checked. */
void sp_handover_describe(const struct sp_handover_header *header,
                          const struct sp_handover_done *done, struct sp_volume_info *info);

/* The header must have been checked. */
struct sp_handover_layout sp_handover_layout(const struct sp_handover_header *header);

/* Copies `size` received bytes into *message and checks every field, including the strings of ERROR
 * and DONE and the grid of HEADER. Coordinates arrive later and are checked then. Fails with
 * SP_ERR_CRASHED at `place`, because a reader that sends a bad message cannot be trusted. Control
 * characters in texts become '?'. */
bool sp_handover_decode(const void *bytes, size_t size, struct sp_handover *message,
                        const char *place, struct sp_error *err);

#endif
