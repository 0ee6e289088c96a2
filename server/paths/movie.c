/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/movie.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "paths/webm_bridge.h"

#define PARTIAL_NAME "movie.part"

/* Reads the file of a packet into memory; malloc'ed, the caller's. NULL with *err set. */
static uint8_t *read_packet(const struct srv_folder *folder, const char *id, const char *name,
                            bool sealed, size_t *size, struct sp_error *err) {
    struct sp_error why = { .code = SP_OK };
    char path[SRV_FILE_BYTES];
    uint64_t all = 0;
    uint8_t *bytes = NULL;
    srv_folder_path(folder, id, name, path);
    int fd = srv_folder_open_file(folder, id, name, sealed, &all, &why);
    bool ok = fd >= 0 && all > 1;
    if (fd < 0 && why.code != SP_ERR_IO) {
        sp_fail(err, SP_ERR_IO, path, "%s", why.text);
        return NULL;
    }
    if (ok && !(bytes = malloc((size_t)all))) {
        sp_fail(err, SP_ERR_MEMORY, path, "out of memory while reading a video packet");
    } else {
        size_t got = 0;
        ssize_t n = 1;
        for (; ok && n > 0 && got < all; got += (size_t)(n > 0 ? n : 0))
            n = read(fd, bytes + got, (size_t)all - got);
        if (n < 0)
            sp_fail(err, SP_ERR_IO, path, "cannot read this file: %s", strerror(errno));
        ok = ok && got == all && bytes[0] <= SRV_PACKET_KEY;
        *size = got;
        if (!ok) {
            if (n >= 0)
                sp_fail(err, SP_ERR_FORMAT, path,
                        "this video packet is damaged; delete the camera path and create it again");
            free(bytes);
            bytes = NULL;
        }
    }
    if (fd >= 0)
        close(fd);
    return bytes;
}

static bool add_packets(struct srv_webm *webm, const struct srv_folder *folder, const char *id,
                        const struct srv_path_output *output, struct sp_error *err) {
    char reason[SRV_WEBM_REASON];
    for (uint32_t i = 0; i < output->frames; i++) {
        char name[32];
        size_t size;
        snprintf(name, sizeof name, "%06u.vp9", i);
        uint8_t *bytes = read_packet(folder, id, name, output->is_sealed, &size, err);
        if (!bytes)
            return false;
        bool ok = srv_webm_add(webm, i, bytes + 1, size - 1, bytes[0] == SRV_PACKET_KEY, reason);
        free(bytes);
        if (!ok)
            return sp_fail(err, SP_ERR_IO, NULL, "cannot write the movie: %s", reason);
    }
    return srv_webm_finish(webm, reason) ||
           sp_fail(err, SP_ERR_IO, NULL, "cannot write the movie: %s", reason);
}

uint64_t srv_movie_bytes_max(uint64_t bytes, uint32_t packets) {
    enum { FILE_BYTES = 512, PACKET_BYTES = 64 }; /* each packet may need a cluster and a cue */
    return bytes + FILE_BYTES + (uint64_t)PACKET_BYTES * packets;
}

bool srv_movie_write(const struct srv_folder *folder, const char *id, const char *name,
                     const struct srv_path_output *output, const uint32_t size[2], uint64_t *bytes,
                     struct sp_error *err) {
    char path[SRV_FILE_BYTES], reason[SRV_WEBM_REASON];
    srv_folder_path(folder, id, PARTIAL_NAME, path);
    struct srv_webm *webm =
        srv_webm_create(path, size[0], size[1], output->fps, output->frames, reason);
    if (!webm)
        return sp_fail(err, SP_ERR_IO, NULL, "cannot write the movie: %s", reason);
    bool ok = add_packets(webm, folder, id, output, err);
    srv_webm_destroy(&webm);
    if (!ok)
        unlink(path);
    if (!ok || !srv_folder_publish(folder, id, PARTIAL_NAME, name, err))
        return false;
    return srv_folder_size(folder, id, name, bytes) ||
           sp_fail(err, SP_ERR_IO, NULL, "the movie file has disappeared");
}
