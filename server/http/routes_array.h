/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_HTTP_ROUTES_ARRAY_H
#define SRV_HTTP_ROUTES_ARRAY_H

#include "http/request.h"
#include "render/catalog.h"

enum { SRV_ARRAY_SOURCE_BYTES = 48 };

/* True if the body of POST /volumes names an array in shared memory. */
bool srv_array_is_for(const proto_json *body);
/* Checks that a body that names none has no member of its description. False: the reply is a
 * problem document. */
bool srv_array_check_absent(const proto_json *body, struct srv_reply *reply);
/* Fills load->memory, load->source, which `source` holds, and its pointer. False: the reply is a
 * problem document. */
bool srv_array_read(const struct srv_request *request, const proto_json *body,
                    char source[SRV_ARRAY_SOURCE_BYTES], struct srv_volume_request *load,
                    struct srv_reply *reply);
/* Forgets the array of a source that the catalog has opened. Does nothing for other sources. */
void srv_array_opened(const struct srv_request *request, const char *source);

#endif
