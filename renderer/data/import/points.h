/* SPDX-License-Identifier: Apache-2.0
 *
 * Points in a table: which columns are their positions, scalars and sizes.
 */
#ifndef SP_IMPORT_POINTS_H
#define SP_IMPORT_POINTS_H

#include "data/import/format.h"

struct import_columns {
    int position[3];
    int scalar;      /* -1 = none: 1 */
    int color[3];    /* red, green and blue; the first is -1 if they are not shown */
    int variance[6]; /* xx, xy, yy, xz, yz, zz; the first is -1 if the table does not have all */
    int volume;      /* -1 = none: of the cell of a grid whose kernel has this variance */
    struct import_shift *shift; /* of the positions; NULL = none */
};

/* Finds columns by their names, in any case, for a file; false if there are no x, y and z. The
 * scalar is the column `file->field`; or else `value`, `scalar` or `intensity`, or the first column
 * that is neither position, size, normal, colour nor texture. Without a scalar, or if `field` is
 * "colors", the points have their colours. A NULL name is never found. */
bool import_columns_find(const struct import_file *file, const char *const *names, unsigned count,
                         struct import_columns *columns);

/* Declares points, and names their scalars and the other fields among `count` columns. */
void import_columns_use(const struct import_columns *columns, const char *const *names,
                        unsigned count, uint32_t points, struct import_header *header);

/* Fills point i from the numbers of its row. */
void import_columns_copy(const struct import_columns *columns, const double *row,
                         const struct sp_elements *points, uint32_t i);

#endif
