/* SPDX-License-Identifier: Apache-2.0
 *
 * Writes a WebM file with one VP9 track, packet by packet. Only webm_bridge.cpp uses libmatroska,
 * which is a C++ library.
 */
#ifndef SRV_PATHS_WEBM_BRIDGE_H
#define SRV_PATHS_WEBM_BRIDGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct srv_webm;
enum { SRV_WEBM_REASON = 200 };

/* Creates the file. If this or a later function fails, `reason` says why, and the partial file
 * stays. */
struct srv_webm *srv_webm_create(const char *path, uint32_t width, uint32_t height, double fps,
                                 uint32_t frames, char reason[SRV_WEBM_REASON]);
/* Adds packet i. Packets come in order; packet 0 must be a key frame. */
bool srv_webm_add(struct srv_webm *webm, uint32_t i, const void *bytes, size_t size, bool is_key,
                  char reason[SRV_WEBM_REASON]);
/* Writes the index by which players seek, and closes the file. Call it last, unless a call failed.
 */
bool srv_webm_finish(struct srv_webm *webm, char reason[SRV_WEBM_REASON]);
void srv_webm_destroy(struct srv_webm **webm); /* accepts NULL */

#ifdef __cplusplus
}
#endif

#endif
