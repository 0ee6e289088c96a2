/* SPDX-License-Identifier: Apache-2.0 */
#include <assert.h>
#include <stdatomic.h>
#include <string.h>
#include <turbojpeg.h>

#include "encode/encoder.h"

enum { FULL_COLOUR_QUALITY = 90 }; /* lowest quality at which AUTO does not subsample colour */

static const struct {
    const char *name;
    int sampling;
} chromas[SP_CHROMA_COUNT] = {
    [SP_CHROMA_AUTO] = { "auto", -1 },
    [SP_CHROMA_444] = { "4:4:4", TJSAMP_444 },
    [SP_CHROMA_422] = { "4:2:2", TJSAMP_422 },
    [SP_CHROMA_420] = { "4:2:0", TJSAMP_420 },
};

const char *sp_chroma_name(enum sp_chroma chroma) {
    assert(chroma < SP_CHROMA_COUNT);
    return chromas[chroma].name;
}

enum sp_chroma sp_chroma_find(const char *name) {
    int i = 0;
    while (i < SP_CHROMA_COUNT && strcmp(chromas[i].name, name) != 0)
        i++;
    return (enum sp_chroma)i;
}

enum sp_chroma sp_chroma_at(enum sp_chroma chroma, int quality) {
    enum sp_chroma by_quality = quality < FULL_COLOUR_QUALITY ? SP_CHROMA_420 : SP_CHROMA_444;
    return chroma == SP_CHROMA_AUTO ? by_quality : chroma;
}

void sp_encoder_set_chroma(struct sp_encoder *encoder, enum sp_chroma chroma) {
    encoder->chroma = chroma;
}

void sp_encoder_set_share(struct sp_encoder *encoder, sp_share_fn *share, void *user) {
    encoder->share = share;
    encoder->share_user = user;
}

/* A large image is cut into stripes by its size alone. Each is encoded as a JPEG of its own:
 *
 *   SOI tables SOF DHT SOS │ scan │ EOI        SOI tables SOF DHT SOS │ scan │ EOI       …
 *   └──────────┬─────────┘   │      │          └───── dropped ──────┘    │      │
 *   SOI tables SOF DHT DRI SOS  scan   RST0                             scan   RST1 …     EOI
 *
 * Joined they are what an encoder makes that restarts after each stripe (ITU-T T.81, B.2.1 and
 * E.1.4, restart intervals): the same coefficients as without stripes. */
enum { STRIPE_PX = 256 << 10, STRIPES_MAX = 32, STRIPE_ALIGN = 16, DRI_BYTES = 6 };
enum { MARK_SOF = 0xc0, MARK_RST = 0xd0, MARK_SOS = 0xda, MARK_DRI = 0xdd };

struct stripes {
    const struct sp_raster *raster;
    int quality, sampling;
    uint32_t rows; /* rows per stripe; the last stripe may have fewer */
    unsigned count;
    uint8_t *bytes; /* output of stripe i begins at i · capacity */
    size_t capacity;
    unsigned long sizes[STRIPES_MAX];
    struct sp_error *err; /* error of the first stripe that fails */
    atomic_bool failed;
};

static void cut(struct stripes *s, uint32_t most) {
    const uint32_t width = s->raster->width, height = s->raster->height;
    uint32_t count = (uint32_t)((uint64_t)width * height / STRIPE_PX);
    count = count < 1 ? 1 : count < most ? count : most;
    s->rows = (height + count - 1) / count;
    if (count > 1)
        s->rows = (s->rows + STRIPE_ALIGN - 1) / STRIPE_ALIGN * STRIPE_ALIGN;
    s->count = (height + s->rows - 1) / s->rows;
    s->capacity = tjBufSize((int)width, (int)s->rows, s->sampling);
}

static void encode_stripe(void *of, unsigned i, struct sp_encoder *with) {
    struct stripes *s = of;
    const struct sp_raster *raster = s->raster;
    uint32_t top = i * s->rows, left = raster->height - top;
    uint8_t *bytes = s->bytes + i * s->capacity;
    if (!with->jpeg)
        with->jpeg = tjInitCompress();
    s->sizes[i] = s->capacity;
    if (with->jpeg &&
        tjCompress2(with->jpeg, (const uint8_t *)raster->pixels + top * raster->stride,
                    (int)raster->width, (int)raster->stride, (int)(left < s->rows ? left : s->rows),
                    TJPF_RGBX, &bytes, &s->sizes[i], s->sampling, s->quality,
                    TJFLAG_NOREALLOC) == 0)
        return;
    if (!atomic_exchange(&s->failed, true))
        sp_fail(s->err, with->jpeg ? SP_ERR_BACKEND : SP_ERR_MEMORY, "",
                "cannot encode a JPEG image of %u × %u: %s", raster->width, raster->height,
                tjGetErrorStr2(with->jpeg));
}

/* Returns the offset of the first segment of that kind in the head of a JPEG; 0 = there is none. */
static size_t find_segment(const uint8_t *jpeg, size_t size, uint8_t mark) {
    size_t at = 2;
    while (at + 4 <= size && jpeg[at + 1] != mark && jpeg[at + 1] != MARK_SOS)
        at += 2 + (size_t)(jpeg[at + 2] << 8 | jpeg[at + 3]);
    return at + 4 <= size && jpeg[at + 1] == mark ? at : 0;
}

/* True if one head, except for its height, is valid for all stripes. Environment variables such as
 * TJ_OPTIMIZE can make the library write different heads. */
static bool are_alike(const struct stripes *s, size_t frame, size_t scan) {
    if (!frame || !scan || find_segment(s->bytes, s->sizes[0], MARK_DRI))
        return false;
    for (unsigned i = 1; i < s->count; i++) {
        const uint8_t *stripe = s->bytes + i * s->capacity;
        if (s->sizes[i] < scan || memcmp(stripe, s->bytes, frame + 5) != 0 ||
            memcmp(stripe + frame + 7, s->bytes + frame + 7, scan - frame - 7) != 0)
            return false;
    }
    return true;
}

/* Moves the head of the first stripe down into the DRI_BYTES before it, and each other scan to the
 * end of the scan before it. False if the stripes cannot be joined; then nothing has changed. */
static bool join(const struct stripes *s, size_t *size) {
    uint8_t *first = s->bytes;
    size_t frame = find_segment(first, s->sizes[0], MARK_SOF),
           scan = find_segment(first, s->sizes[0], MARK_SOS);
    if (!are_alike(s, frame, scan))
        return false;
    uint32_t unit_width = (uint32_t)tjMCUWidth[s->sampling],
             unit_rows = s->rows / (uint32_t)tjMCUHeight[s->sampling],
             interval = (s->raster->width + unit_width - 1) / unit_width * unit_rows;
    first[frame + 5] = (uint8_t)(s->raster->height >> 8);
    first[frame + 6] = (uint8_t)s->raster->height;
    memmove(first - DRI_BYTES, first, scan);
    memcpy(first + scan - DRI_BYTES,
           (const uint8_t[DRI_BYTES]){ 0xff, MARK_DRI, 0, 4, (uint8_t)(interval >> 8),
                                       (uint8_t)interval },
           DRI_BYTES);
    uint8_t *end = first + s->sizes[0];
    scan += 2 + (size_t)(first[scan + 2] << 8 | first[scan + 3]);
    for (unsigned i = 1; i < s->count; i++) {
        end[-1] = (uint8_t)(MARK_RST + (i - 1) % 8); /* RST overwrites EOI */
        memmove(end, s->bytes + i * s->capacity + scan, s->sizes[i] - scan);
        end += s->sizes[i] - scan;
    }
    *size = (size_t)(end - first) + DRI_BYTES;
    return true;
}

static bool encode(struct sp_encoder *encoder, struct stripes *s, uint32_t most) {
    cut(s, most);
    size_t before = s->count > 1 ? DRI_BYTES : 0;
    if (!sp_buffer_reserve(&encoder->output, before + s->count * s->capacity, s->err))
        return false;
    s->bytes = encoder->output.bytes + before;
    if (encoder->share && s->count > 1)
        encoder->share(encoder->share_user, encoder, s->count, encode_stripe, s);
    else
        for (unsigned i = 0; i < s->count; i++)
            encode_stripe(s, i, encoder);
    encoder->output.size = s->sizes[0];
    return !atomic_load(&s->failed);
}

bool sp_encode_jpeg(struct sp_encoder *encoder, const struct sp_raster *raster, int quality,
                    struct sp_error *err) {
    struct stripes s = { .raster = raster,
                         .quality = quality,
                         .sampling = chromas[sp_chroma_at(encoder->chroma, quality)].sampling,
                         .err = err };
    if (!encode(encoder, &s, STRIPES_MAX))
        return false;
    return s.count == 1 || join(&s, &encoder->output.size) || encode(encoder, &s, 1);
}

void sp_encode_jpeg_finish(struct sp_encoder *encoder) {
    if (encoder->jpeg)
        tjDestroy(encoder->jpeg);
    encoder->jpeg = NULL;
}
