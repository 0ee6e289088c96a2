/* SPDX-License-Identifier: Apache-2.0 */
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "encode/encoder.h"

#if defined(__SANITIZE_THREAD__)
/* The library's thread pool guards its tables with spin locks, which TSan cannot see in a library
 * that was not built with it. */
__attribute__((visibility("default"))) const char *__tsan_default_suppressions(void);
const char *__tsan_default_suppressions(void) {
    return "called_from_lib:libOpenImageIO_Util.so\n";
}
#endif

static const char bridge_name[] = "splat-oiio.so";

/* Where the bridge may lie, seen from the folder of the running program: beside it, in the library
 * folder of an installation, beside the programs of a build tree whose tests are elsewhere. */
static const char *const bridge_folders[] = { "", "../lib/splatd/", "../bin/" };

static bool program_folder(char *folder, size_t size, struct sp_error *err) {
    ssize_t n = readlink("/proc/self/exe", folder, size - 1);
    if (n < 0)
        return sp_fail(err, SP_ERR_IO, "/proc/self/exe", "cannot find %s: %s", bridge_name,
                       strerror(errno));
    folder[n] = 0;
    char *slash = strrchr(folder, '/');
    slash[1] = 0; /* the kernel gives an absolute path */
    return true;
}

/* RTLD_NODELETE: the library registers destructors of its own that must find it mapped. */
static bool load_bridge(struct sp_encoder *encoder, struct sp_error *err) {
    char folder[3840], path[4096], first[4096] = "";
    if (!program_folder(folder, sizeof folder, err))
        return false;
    for (size_t i = 0; i < sizeof bridge_folders / sizeof *bridge_folders; i++) {
        snprintf(path, sizeof path, "%s%s%s", folder, bridge_folders[i], bridge_name);
        if (i == 0)
            memcpy(first, path, sizeof first);
        if (access(path, F_OK) != 0)
            continue;
        void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
        if (!library)
            return sp_fail(err, SP_ERR_IO, path, "cannot load the image library: %s", dlerror());
        encoder->oiio = (sp_oiio_encode_fn *)dlsym(library, "splat_oiio_encode");
        dlclose(library);
        if (!encoder->oiio)
            return sp_fail(err, SP_ERR_IO, path, "is not the image library of this program");
        return true;
    }
    return sp_fail(err, SP_ERR_IO, first,
                   "the image library is not there; every format but JPEG needs it");
}

static int keep(void *user, const void *bytes, size_t size) {
    struct sp_buffer *output = user;
    if (!sp_buffer_reserve(output, size, NULL))
        return 0;
    memcpy(output->bytes, bytes, size);
    output->size = size;
    return 1;
}

bool sp_encode_oiio(struct sp_encoder *encoder, const struct sp_raster *raster,
                    const struct sp_image_format_info *format, int quality, struct sp_error *err) {
    if (!encoder->oiio && !load_bridge(encoder, err))
        return false;
    const struct sp_oiio_image image = {
        .extension = format->extension,
        .pixels = raster->pixels,
        .width = raster->width,
        .height = raster->height,
        .channels = raster->channels,
        .stride = raster->stride,
        .is_float = raster->is_float,
        .quality = quality,
    };
    char why[256] = "";
    switch (encoder->oiio(&image, keep, &encoder->output, why, sizeof why)) {
    case SP_OIIO_DONE:
        return true;
    case SP_OIIO_MEMORY:
        return sp_fail(err, SP_ERR_MEMORY, "", "no memory to encode %u × %u as %s", raster->width,
                       raster->height, format->name);
    case SP_OIIO_FAILED:
        break;
    }
    return sp_fail(err, SP_ERR_BACKEND, "", "cannot encode %u × %u as %s: %s", raster->width,
                   raster->height, format->name, why);
}
