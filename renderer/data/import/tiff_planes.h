/* SPDX-License-Identifier: Apache-2.0
 *
 * Finds which page of a TIFF is which slice, channel and time step: from the descriptions that
 * programs write, OME-XML (tiff_ome.c), ImageJ (tiff_imagej.c) and tifffile (tiff_shaped.c), and
 * from tags (tiff_layout.c).
 */
#ifndef SP_IMPORT_TIFF_PLANES_H
#define SP_IMPORT_TIFF_PLANES_H

#include "data/import/tiff_file.h"

struct tiff_planes {
    uint32_t slices, channels, steps; /* at least 1; channels that have pages of their own */
    uint32_t *pages; /* owned: of slice k, channel c and step t at (t·channels + c)·slices + k */
    /* The samples of a pixel are planes of their own, one after the other, and `pages` has numbers
     * of planes: `split` for each page. 0 = the samples are channels of a page. */
    unsigned split;
    char (*names)[SP_FIELD_BYTES]; /* owned: of the channels; "" = none. NULL = all have none */
    double spacing[3];             /* of x, y and z; 0 = unknown */
    char unit[SP_UNIT_BYTES];
    bool has_own_unit; /* the description gives it, so that the tags of the resolution do not */
    double origin[3], direction[3][3]; /* as in struct sp_grid */
    bool has_place;                    /* these two are known */
    /* Only the first page has a directory; plane n, in the order of `pages`, follows its pixels. */
    bool is_hidden;
    bool are_indices;  /* of a palette, which only serves to show them */
    bool are_channels; /* the samples of a pixel, even where the page calls them colours */
    bool are_plain;    /* The file says MinIsWhite, but its numbers are not inverted. */
    bool has_scale;    /* sample = slope · number + offset, for whole numbers of one channel */
    double slope, offset;
    char value_unit[SP_UNIT_BYTES];
    bool has_missing; /* numbers equal to `missing` are no samples */
    double missing;
    double interval; /* of the steps; 0 = unknown */
    double *times;   /* owned: of each step, in place of the interval; NULL = unknown */
    char time_unit[SP_UNIT_BYTES];
};

enum { TIFF_NO_PAGE = UINT32_MAX };

/* The page of an entry of `pages`. */
static inline uint32_t tiff_planes_page(const struct tiff_planes *planes, uint32_t n) {
    return planes->split && n != TIFF_NO_PAGE ? n / planes->split : n;
}

/* Allocates the pages, of which none is known yet. `most`: how many pages the file has; more
 * planes than a hundred times that are refused. */
bool tiff_planes_allocate(struct tiff_planes *planes, const struct import_file *file, uint32_t most,
                          struct sp_error *err);
void tiff_planes_finish(struct tiff_planes *planes);

/* Fills the planes from the descriptions and tags of the file. `description`: of the first page. */
bool tiff_layout_parse(struct tiff_planes *planes, const struct tiff_file *tiff,
                       const char *description, struct sp_error *err);

/* Finds the size and place of a pixel in the tags of the first page, unless the planes have them.
 */
void tiff_layout_place(struct tiff_planes *planes, const struct tiff_file *tiff,
                       const char *description);

/* Converts the spacing along an axis from `unit` to the unit of the planes. Warns if it cannot, and
 * keeps the number. */
void tiff_planes_convert(struct tiff_planes *planes, const struct import_file *file, int axis,
                         const char *unit);

/* Pixels per unit (1 none, 2 inch, 3 cm) from the tags. False if there are none that make sense. */
bool tiff_resolution(const struct tiff_file *tiff, const struct tiff_page *page, double *x,
                     double *y, double *unit);

/* Gives the axis that is free another meaning if the source wants one ("?as=time"): the channels
 * that have pages of their own, or else the steps, or else the slices. Of the `samples` of a pixel
 * only colours and channels can be chosen; then *are_colors changes instead. */
bool tiff_planes_choose(struct tiff_planes *planes, const struct import_file *file,
                        unsigned samples, bool *are_colors, struct import_header *header,
                        struct sp_error *err);

/* Reads the JSON that tifffile writes (tiff_shaped.c): {"shape": [2, 6, 32, 48], "axes": "CZYX"}.
 */
bool tiff_is_shaped(const char *description);
bool tiff_shaped_parse(struct tiff_planes *planes, const struct tiff_file *tiff,
                       const char *description, struct sp_error *err);

/* Reads the lines that ImageJ writes (tiff_imagej.c). */
bool tiff_is_imagej(const char *description);
bool tiff_imagej_parse(struct tiff_planes *planes, const struct tiff_file *tiff,
                       const char *description, struct sp_error *err);

/* Fails at "TITLE: page N". */
__attribute__((format(printf, 5, 6))) bool tiff_fail(const struct tiff_file *tiff, uint32_t page,
                                                     struct sp_error *err, enum sp_code code,
                                                     const char *format, ...);

/* The planes that follow the pixels of the first page, which count as one there; `needed` of them
 * must be in the file. */
bool tiff_planes_hide(struct tiff_planes *planes, const struct tiff_file *tiff, uint64_t needed);

/* True if a description is OME-XML. */
bool tiff_is_ome(const char *description);

/* Reads OME-XML of `size` bytes. `pages`: of the file; `samples`: channels within a page. Only the
 * first image is read. Planes in other files are an error that names one. */
bool tiff_ome_parse(struct tiff_planes *planes, const struct import_file *file, const char *xml,
                    size_t size, uint32_t pages, unsigned samples, struct sp_error *err);

#endif
