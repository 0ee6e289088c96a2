/* SPDX-License-Identifier: Apache-2.0
 *
 * The packets of a job, a file each while it is drawn, become a WebM file.
 */
#ifndef SRV_PATHS_MOVIE_H
#define SRV_PATHS_MOVIE_H

#include "paths/folder.h"
#include "paths/keyframes.h"

/* What a packet's file begins with: one byte. */
enum { SRV_PACKET_DELTA = 0, SRV_PACKET_KEY = 1 };

/* Bytes that the movie has at most of so many packets, whose files have `bytes`. */
uint64_t srv_movie_bytes_max(uint64_t bytes, uint32_t packets);

/* Writes `name` of all packets, 000000.vp9 and so on; *bytes is its size. SP_ERR_IO, SP_ERR_MEMORY,
 * SP_ERR_FORMAT (a packet that is none). */
bool srv_movie_write(const struct srv_folder *folder, const char *id, const char *name,
                     const struct srv_path_output *output, const uint32_t size[2], uint64_t *bytes,
                     struct sp_error *err);

#endif
