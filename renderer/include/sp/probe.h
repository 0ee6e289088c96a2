/* SPDX-License-Identifier: Apache-2.0
 *
 * Lists the devices of this machine that the backends can render on, and why they refuse other
 * devices.
 */
#ifndef SP_PROBE_H
#define SP_PROBE_H

#include <stdbool.h>
#include <stdint.h>

#include "sp/api.h"
#include "sp/frame.h"
#include "sp/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The largest values that a GPU accepts; 0 = it does not report one. */
struct sp_gpu_limits {
    uint64_t video_bytes;         /* memory of the GPU; some drivers report only the free part */
    uint64_t storage_block_bytes; /* bytes of one buffer that a shader can access */
    unsigned storage_blocks;      /* buffers that a compute shader can access at a time */
    unsigned storage_alignment;   /* bytes; alignment of a block inside a buffer */
    unsigned shared_bytes;        /* memory that a work group shares */
    unsigned group_invocations;   /* threads per work group */
    unsigned group_size[3];       /* threads per work group, per axis */
    unsigned group_count[3];      /* work groups per dispatch, per axis */
};

/* A device that a backend can render on, or an attempt to reach one that fails. Texts are cut to
 * fit. */
struct sp_device {
    const char *backend;       /* constant string: the backend that would use it */
    char place[96];            /* "EGL device 0 (/dev/dri/card0)", "surfaceless display", … */
    enum sp_code refusal_code; /* SP_OK = the device works, and the fields below are set; otherwise
                                  why it does not work */
    char refusal[SP_ERROR_TEXT];  /* the reason as text; "" = the device works */
    bool is_gpu;                  /* a hardware GPU */
    int gpu;                      /* number for sp_renderer_options.gpu; −1 = none */
    char name[SP_DEVICE_NAME];    /* as in sp_renderer_info.device */
    char vendor[SP_DEVICE_NAME];  /* "" = not reported, as for the next two fields */
    char version[SP_DEVICE_NAME]; /* version of OpenGL; CPU: its instruction sets */
    char driver[SP_DEVICE_NAME];
    unsigned threads; /* threads of a CPU; 0 for other devices */
    /* limits of a GPU, or of software that acts as a GPU; otherwise 0 */
    struct sp_gpu_limits limits;
};

/* Called once per device, before sp_probe() returns. *device is valid during the call. */
typedef void sp_device_visit(void *user, const struct sp_device *device);

/* Tries every device that the backends know, GPUs first, and reports each to `visit`. Returns true
 * if a hardware GPU works. Takes a few hundred ms. Thread-safe. */
SP_API bool sp_probe(sp_device_visit *visit, void *user);

#ifdef __cplusplus
}
#endif

#endif
