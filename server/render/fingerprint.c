/* SPDX-License-Identifier: Apache-2.0 */
#include "render/fingerprint.h"

#include <assert.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <xxhash.h>

struct srv_fingerprint srv_fingerprint_of(const struct srv_piece *pieces, unsigned count) {
    XXH128_hash_t hashes[SRV_PIECES_MAX];
    assert(count <= SRV_PIECES_MAX);
    for (unsigned i = 0; i < count; i++)
        hashes[i] = XXH3_128bits(pieces[i].bytes, pieces[i].size);
    XXH128_hash_t all = XXH3_128bits(hashes, count * sizeof *hashes);
    return (struct srv_fingerprint){ .high = all.high64, .low = all.low64 };
}

struct srv_fingerprint srv_fingerprint_volume(const struct sp_volume *volume) {
    enum { AXES = 3, OTHERS = 6 };
    const struct sp_volume_info *info = sp_volume_info(volume);
    const struct sp_grid *grid = &info->grid;
    uint32_t type = info->type;
    struct srv_piece pieces[OTHERS + AXES + 3] = {
        { grid->dims, sizeof grid->dims },
        { grid->spacing, sizeof grid->spacing },
        { grid->origin, sizeof grid->origin },
        { grid->direction, sizeof grid->direction },
        { &type, sizeof type },
        { sp_volume_voxels(volume), info->voxel_bytes },
    };
    for (int a = 0; a < AXES; a++)
        if (grid->coordinates[a])
            pieces[OTHERS + a] = (struct srv_piece){ grid->coordinates[a],
                                                     grid->dims[a] * sizeof *grid->coordinates[a] };
    unsigned count = OTHERS + AXES;
    if (info->whole.dims[0])
        pieces[count++] = (struct srv_piece){ &info->whole, sizeof info->whole };
    if (info->vector_bytes)
        pieces[count++] = (struct srv_piece){ sp_volume_vectors(volume), info->vector_bytes };
    if (info->element_bytes) { /* all arrays lie behind the sample */
        pieces[count++] = (struct srv_piece){ &info->elements, sizeof info->elements };
        pieces[count++] = (struct srv_piece){ sp_volume_voxels(volume), info->element_bytes };
    }
    return srv_fingerprint_of(pieces, count);
}

bool srv_fingerprint_program(struct srv_fingerprint *fingerprint) {
    struct stat st;
    int fd = open("/proc/self/exe", O_RDONLY | O_CLOEXEC);
    size_t size = fd >= 0 && fstat(fd, &st) == 0 ? (size_t)st.st_size : 0;
    void *bytes = size ? mmap(NULL, size, PROT_READ, MAP_PRIVATE, fd, 0) : MAP_FAILED;
    bool ok = bytes != MAP_FAILED;
    if (ok) {
        *fingerprint = srv_fingerprint_of(&(struct srv_piece){ bytes, size }, 1);
        munmap(bytes, size);
    }
    if (fd >= 0)
        close(fd);
    return ok;
}

bool srv_fingerprint_equal(const struct srv_fingerprint *a, const struct srv_fingerprint *b) {
    return a->high == b->high && a->low == b->low;
}

void srv_fingerprint_encode(const struct srv_fingerprint *fingerprint,
                            char text[SRV_FINGERPRINT_TEXT]) {
    snprintf(text, SRV_FINGERPRINT_TEXT, "%016" PRIx64 "%016" PRIx64, fingerprint->high,
             fingerprint->low);
}

bool srv_fingerprint_decode(const char *text, struct srv_fingerprint *fingerprint) {
    const size_t digits = SRV_FINGERPRINT_TEXT - 1;
    return text && strlen(text) == digits && strspn(text, "0123456789abcdef") == digits &&
           sscanf(text, "%16" SCNx64 "%16" SCNx64, &fingerprint->high, &fingerprint->low) == 2;
}
