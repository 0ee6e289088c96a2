/* SPDX-License-Identifier: Apache-2.0
 *
 * Builds a WebM file from the video packets of a path. While the path renders, each packet is a
 * file.
 */
#ifndef SRV_PATHS_MOVIE_H
#define SRV_PATHS_MOVIE_H

#include "paths/folder.h"
#include "paths/keyframes.h"

/* The first byte of a packet's file. */
enum { SRV_PACKET_DELTA = 0, SRV_PACKET_KEY = 1 };

/* Returns an upper bound for the size of a movie of `packets` packets, whose files have `bytes`. */
uint64_t srv_movie_bytes_max(uint64_t bytes, uint32_t packets);

/* Writes the file `name` from the packets 000000.vp9 and so on; *bytes is its size. False:
 * SP_ERR_IO, SP_ERR_MEMORY, SP_ERR_FORMAT (a file is not a packet). */
bool srv_movie_write(const struct srv_folder *folder, const char *id, const char *name,
                     const struct srv_path_output *output, const uint32_t size[2], uint64_t *bytes,
                     struct sp_error *err);

#endif
