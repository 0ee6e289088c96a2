/* SPDX-License-Identifier: Apache-2.0
 *
 * A WebM file of one VP9 track, written packet by packet. The only file that knows libmatroska is
 * webm_bridge.cpp.
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

/* Creates the file. On failure, here and below, `reason` says why; what was written stays. */
struct srv_webm *srv_webm_create(const char *path, uint32_t width, uint32_t height, double fps,
                                 uint32_t frames, char reason[SRV_WEBM_REASON]);
/* Packet i of the file, the first one 0 and a key frame. */
bool srv_webm_add(struct srv_webm *webm, uint32_t i, const void *bytes, size_t size, bool is_key,
                  char reason[SRV_WEBM_REASON]);
/* Writes what is left: an index by which players seek. Call it last, unless something failed. */
bool srv_webm_finish(struct srv_webm *webm, char reason[SRV_WEBM_REASON]);
void srv_webm_destroy(struct srv_webm **webm); /* accepts NULL */

#ifdef __cplusplus
}
#endif

#endif
