/* SPDX-License-Identifier: Apache-2.0
 *
 * The headers of the tus protocol 1.0 (tus.io/protocols/resumable-upload), and checksums. Pure
 * functions; a parser accepts NULL for a missing header.
 */
#ifndef SRV_HTTP_UPLOAD_HEADERS_H
#define SRV_HTTP_UPLOAD_HEADERS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SRV_TUS_VERSION "1.0.0"
#define SRV_TUS_EXTENSIONS "creation,expiration,checksum,termination"
#define SRV_TUS_CHECKSUMS "sha1,sha256,sha512,md5"
#define SRV_UPLOAD_TYPE "application/offset+octet-stream"

enum { SRV_DIGEST_BYTES = 64, SRV_METADATA_BYTES = 1024 };

/* Parses a whole number in [0, 2^53]: digits only. */
bool srv_upload_number(const char *text, uint64_t *number);

/* Finds a key in Upload-Metadata ("filename d29ybGQ=,type dGV4dA==") and decodes its value, which
 * gets a NUL behind it. False: there is no such key, its value is longer than fits or not base64,
 * or has a NUL inside. */
bool srv_upload_metadata(const char *header, const char *key, char value[SRV_METADATA_BYTES],
                         size_t *length);

struct srv_checksum; /* computes the digest of a stream of bytes */

/* Parses Upload-Checksum ("sha1 BASE64"). False: the algorithm is not one of SRV_TUS_CHECKSUMS, or
 * the digest does not have its length. */
bool srv_checksum_parse(const char *header, int *algorithm, unsigned char digest[SRV_DIGEST_BYTES]);
/* NULL when out of memory. */
struct srv_checksum *srv_checksum_create(int algorithm,
                                         const unsigned char expected[SRV_DIGEST_BYTES]);
void srv_checksum_add(struct srv_checksum *checksum, const void *bytes, size_t size);
/* Ends the computation and frees; accepts NULL, which matches. */
bool srv_checksum_matches(struct srv_checksum **checksum);

#endif
