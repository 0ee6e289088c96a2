/* SPDX-License-Identifier: Apache-2.0 */
#include "ops/probe.h"

#include <inttypes.h>

#include "sp/log.h"
#include "sp/probe.h"
#include "sp/renderer.h"

static void print_text(FILE *out, const char *what, const char *text) {
    if (text[0])
        fprintf(out, "  %-16s %s\n", what, text);
}

/* Prints a size in the largest unit that divides it; 0 = unknown. */
static void print_bytes(FILE *out, const char *what, uint64_t bytes) {
    static const char *const units[] = { "bytes", "KiB", "MiB", "GiB", "TiB" };
    unsigned unit = 0;
    uint64_t count = bytes;
    for (; count && count % 1024 == 0 && unit < 4; unit++)
        count /= 1024;
    if (bytes)
        fprintf(out, "  %-16s %" PRIu64 " %s\n", what, count, units[unit]);
    else
        fprintf(out, "  %-16s unknown\n", what);
}

static void print_limits(FILE *out, const struct sp_gpu_limits *limits) {
    const unsigned *size = limits->group_size, *count = limits->group_count;
    print_bytes(out, "video memory", limits->video_bytes);
    print_bytes(out, "storage block", limits->storage_block_bytes);
    fprintf(out, "  %-16s %u per shader, aligned to %u bytes\n", "storage blocks",
            limits->storage_blocks, limits->storage_alignment);
    print_bytes(out, "shared memory", limits->shared_bytes);
    fprintf(out, "  %-16s %u invocations, at most %u x %u x %u; %u x %u x %u groups\n",
            "work group", limits->group_invocations, size[0], size[1], size[2], count[0], count[1],
            count[2]);
}

static void print_device(void *user, const struct sp_device *device) {
    FILE *out = user;
    fprintf(out, "%s: %s%s\n", device->backend, device->place,
            device->refusal_code != SP_OK ? " does not work" : "");
    print_text(out, "because", device->refusal);
    if (device->refusal_code == SP_OK && !device->threads && !device->is_gpu)
        print_text(out, "kind", "software GL: used when it is named, never as a GPU");
    print_text(out, "device", device->name);
    print_text(out, "vendor", device->vendor);
    print_text(out, device->threads ? "sets" : "OpenGL", device->version);
    print_text(out, "driver", device->driver);
    if (device->threads)
        fprintf(out, "  %-16s %u\n", "cores", device->threads);
    else if (device->refusal_code == SP_OK)
        print_limits(out, &device->limits);
}

bool srv_probe(FILE *out) {
    sp_log_set_level(SP_LOG_WARN); /* successes are printed below */
    bool works = sp_probe(print_device, out);
    fprintf(out, works ? "A GPU works.\n" : "No GPU works.\n");
    return works;
}
