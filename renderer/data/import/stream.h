/* SPDX-License-Identifier: Apache-2.0
 *
 * A file with samples, and the decoder of its bytes.
 */
#ifndef SP_IMPORT_STREAM_H
#define SP_IMPORT_STREAM_H

#include <bzlib.h>
#include <zlib.h>

#include "data/import/number.h"

enum import_encoding {
    IMPORT_RAW,
    IMPORT_GZIP, /* or zlib */
    IMPORT_BZIP2,
    IMPORT_HEX,  /* two hexadecimal digits per byte; blanks are skipped */
    IMPORT_TEXT, /* numbers with blanks or commas between them; native byte order comes out */
};

enum { IMPORT_STREAM_CHUNK = 1 << 20 }; /* bytes; the most that one call decodes */

/* The limit of deflate: 258 bytes from two codes of one bit each. */
enum { DEFLATE_RATIO_MAX = 1032 };

struct import_stream {
    int fd;
    bool owned; /* fd */
    const char *title;
    uint64_t size, at; /* file bytes; at: what was read from the file so far */
    enum import_encoding encoding;
    struct import_number number; /* of IMPORT_TEXT: what comes out */
    bool ended;
    bool is_gzip;     /* of IMPORT_GZIP: else zlib */
    bool has_garbage; /* of gzip: other bytes than 0 follow its end */
    z_stream z;
    bz_stream bz;
    size_t used, filled; /* of `in`, for HEX and TEXT */
    uint8_t in[1 << 16];
};

/* Takes a file, which close() closes if it is `owned`. */
void import_stream_open(struct import_stream *stream, int fd, bool owned, const char *title,
                        uint64_t size);
void import_stream_close(struct import_stream *stream);

/* Move the read position. Call them before import_stream_begin(). */
bool import_stream_seek(struct import_stream *stream, uint64_t byte, struct sp_error *err);
bool import_stream_skip_lines(struct import_stream *stream, uint64_t lines, struct sp_error *err);

/* Starts to decode at the read position. */
bool import_stream_begin(struct import_stream *stream, enum import_encoding encoding,
                         struct import_number number, struct sp_error *err);

/* Reads up to n decoded bytes, at most IMPORT_STREAM_CHUNK unless the encoding is RAW. Fewer come
 * at the end of the data only. Of TEXT, n is a multiple of the size of a number. */
bool import_stream_read(struct import_stream *stream, void *out, size_t n, size_t *got,
                        struct sp_error *err);

/* As import_stream_read() of RAW, into memory that is 0: bytes of holes are neither read nor
 * touched, so that the memory of a sparse file stays sparse. */
bool import_stream_read_sparse(struct import_stream *stream, char *out, size_t n, size_t *got,
                               struct sp_error *err);

/* Reads the start of the file, which may be packed with gzip. Returns how many bytes there are, at
 * most `size`. */
size_t import_stream_head(const struct import_file *file, void *out, size_t size, bool *is_packed);

/* True if `file_bytes` bytes of a file can decode to `bytes` bytes. */
bool import_stream_may_hold(enum import_encoding encoding, struct import_number number,
                            uint64_t file_bytes, uint64_t bytes);

/* "gzip", … as in errors. */
const char *import_encoding_name(enum import_encoding encoding);

#endif
