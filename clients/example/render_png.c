/* SPDX-License-Identifier: Apache-2.0
 * render_png SOURCE OUTPUT.png: renders a volume with its default view, using libsplat alone. */
#include <stdio.h>

#include "sp/encode.h"
#include "sp/renderer.h"

static bool write_file(const char *path, const uint8_t *bytes, size_t size, struct sp_error *err) {
    FILE *file = fopen(path, "wb");
    bool is_written = file && fwrite(bytes, 1, size, file) == size;
    return (file && fclose(file) == 0 && is_written) ||
           sp_fail(err, SP_ERR_IO, path, "cannot write %zu bytes", size);
}

int main(int argc, char **argv) {
    const struct sp_renderer_options options = { .backend = "cpu" };
    struct sp_error err = { .text = "usage: render_png SOURCE OUTPUT.png" };
    struct sp_volume *volume = argc == 3 ? sp_volume_load(argv[1], NULL, &err) : NULL;
    struct sp_renderer *renderer = volume ? sp_renderer_create(&options, &err) : NULL;
    struct sp_frame_pool *pool = renderer ? sp_frame_pool_create(0, &err) : NULL;
    struct sp_encoder *encoder = pool ? sp_encoder_create(&err) : NULL;
    struct sp_frame *frame = NULL;
    const uint8_t *bytes;
    size_t size;
    if (encoder) {
        struct sp_view view;
        sp_view_choose(&view, volume, "example");
        frame = sp_renderer_render(renderer, volume, &view, pool, NULL, &err);
    }
    bool ok = frame && sp_encode(encoder, frame, SP_IMAGE_PNG, 100, &bytes, &size, &err) &&
              write_file(argv[2], bytes, size, &err);
    if (!ok)
        fprintf(stderr, "%s: %s\n", err.place, err.text);
    sp_frame_unref(&frame);
    sp_encoder_destroy(&encoder);
    sp_frame_pool_destroy(&pool);
    sp_renderer_destroy(&renderer);
    sp_volume_unref(&volume);
    return ok ? 0 : 1;
}
