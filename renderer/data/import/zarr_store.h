/* SPDX-License-Identifier: Apache-2.0
 *
 * Objects of a Zarr hierarchy by their keys ("0/.zarray", "0/c/1/2/3"): files of a folder, or bytes
 * elsewhere. All parts of the Zarr reader read through this interface:
 *
 *   zarr_store ─► zarr_node (JSON) ─► zarr_array ─► zarr_image (levels) ─► zarr_chunk (samples)
 *
 * A store and its users belong to one thread.
 */
#ifndef SP_IMPORT_ZARR_STORE_H
#define SP_IMPORT_ZARR_STORE_H

#include "data/import/format.h"

enum { ZARR_KEY_BYTES = 1024 };

enum zarr_found { ZARR_FAILED, ZARR_MISSING, ZARR_FOUND };

struct zarr_store {
    void *user;
    const char *title; /* the name in errors */
    /* The size of an object in bytes. ZARR_MISSING is no error; ZARR_FAILED sets *err. */
    enum zarr_found (*size)(void *user, const char *key, uint64_t *size, struct sp_error *err);
    /* Reads `size` bytes from `offset` on; *got is smaller only at the end of the object. */
    enum zarr_found (*read)(void *user, const char *key, uint64_t offset, void *out, size_t size,
                            size_t *got, struct sp_error *err);
    /* Calls visit() for each name below a key, in any order, until it returns false. NULL = the
     * store cannot list. */
    void (*list)(void *user, const char *key, bool (*visit)(void *to, const char *name), void *to);
};

/* The folder of a file, whose files are opened below file->root only. The file must stay valid.
 * NULL without memory. */
struct zarr_store *zarr_folder_open(const struct import_file *file);
void zarr_folder_close(struct zarr_store **store);

/* Fails at "TITLE: KEY: POINTER"; the pointer may be "". */
__attribute__((format(printf, 6, 7))) bool zarr_fail(const struct zarr_store *store,
                                                     struct sp_error *err, enum sp_code code,
                                                     const char *key, const char *pointer,
                                                     const char *format, ...);

/* Writes "PATH/NAME", or "NAME" if the path is "". False if it is too long. */
bool zarr_key(char key[ZARR_KEY_BYTES], const char *path, const char *name);

#endif
