/* SPDX-License-Identifier: Apache-2.0
 *
 * A list of files, each a step in time: ParaView's .pvd (XML) and FILE.series (JSON).
 */
#ifndef SP_IMPORT_COLLECTION_H
#define SP_IMPORT_COLLECTION_H

#include "data/import/format.h"

struct collection_file {
    double time;
    char *name; /* owned; relative to the folder of the list */
};

struct collection {                /* all zero = empty */
    struct collection_file *files; /* owned; by time */
    double *times;                 /* owned */
    uint32_t count;
};

/* As import_format.probe. */
bool collection_probe(const uint8_t *start, size_t size, const char *title);

/* Reads the list, which has one file at least. The caller finishes it, also after a failure. */
bool collection_read(const struct import_file *file, struct collection *collection,
                     struct sp_error *err);
void collection_finish(struct collection *collection);

#endif
