/* SPDX-License-Identifier: Apache-2.0 */
#include "http/smuggling.h"

#include <string.h>
#include <strings.h>

struct srv_rejection srv_smuggling_check_target(char *target, size_t limit) {
    char *query = strchr(target, '?');
    unsigned count = 0;
    for (const char *c = query; c && *c; c++)
        count += *c == '&';
    bool is_long = strlen(target) > limit;
    if (query && (is_long || count > SRV_QUERY_AMPERSANDS_MAX))
        memset(query + 1, 0, strlen(query + 1));
    if (is_long)
        return (struct srv_rejection){ 414,
                                       "the address is longer than a quarter of --header-size" };
    if (count > SRV_QUERY_AMPERSANDS_MAX)
        return (struct srv_rejection){ 414, "the query has more than 16 '&'" };
    if (strstr(target, "%00"))
        return (struct srv_rejection){ 400, "the address contains %00" };
    return (struct srv_rejection){ 0, NULL };
}

static bool is_name(const char *name) {
    size_t length = strspn(name, "0123456789abcdefghijklmnopqrstuvwxyz"
                                 "ABCDEFGHIJKLMNOPQRSTUVWXYZ!#$%&'*+-.^_`|~");
    return length > 0 && !name[length];
}

/* True for a valid header value (RFC 9110, section 5.5). */
static bool is_text(const char *value) {
    for (const char *c = value; *c; c++)
        if (((unsigned char)*c < ' ' && *c != '\t') || *c == 127)
            return false;
    return true;
}

enum { LINE_END = 2 }; /* CR LF */

void srv_smuggling_begin(struct srv_smuggling *smuggling, const char *method, size_t target_size,
                         const char *version) {
    smuggling->is_torn = method + strlen(method) + 1 + target_size + 1 != version;
    smuggling->next = version + strlen(version) + LINE_END;
}

void srv_smuggling_end(struct srv_smuggling *smuggling, const char *end) {
    smuggling->is_torn |= smuggling->next + LINE_END != end;
}

void srv_smuggling_add_header(struct srv_smuggling *smuggling, const char *name,
                              const char *value) {
    const char *text = value ? value : "";
    smuggling->all++;
    if (smuggling->next) {
        smuggling->is_torn |= name != smuggling->next || !value;
        smuggling->next = text + strlen(text) + LINE_END;
    }
    if (!is_name(name))
        smuggling->is_not_name = true;
    if (!is_text(text))
        smuggling->is_not_text = true;
    if (strcasecmp(name, "Host") == 0)
        smuggling->hosts++;
    if (strcasecmp(name, "Content-Length") == 0) {
        smuggling->lengths++;
        size_t digits = strspn(text, "0123456789");
        smuggling->is_not_number |= digits < 1 || digits > 19 || text[digits];
    }
    if (strcasecmp(name, "Transfer-Encoding") == 0) {
        smuggling->encodings++;
        smuggling->is_not_chunked |= strcasecmp(text, "chunked") != 0;
    }
}

struct srv_rejection srv_smuggling_check_headers(const struct srv_smuggling *smuggling,
                                                 const char *version) {
    bool is_old = strcmp(version, "HTTP/1.0") == 0;
    const char *detail = NULL;
    if (smuggling->all > SRV_HEADERS_MAX)
        return (struct srv_rejection){ 431, "the request has more than 128 headers" };
    if (smuggling->is_torn)
        detail = "the head has a NUL, a line that continues another, a line that does not end "
                 "with CR LF, or more than one blank behind the method";
    else if (smuggling->is_not_name)
        detail = "the name of a header has an invalid character";
    else if (smuggling->is_not_text)
        detail = "the value of a header has a control character";
    else if (smuggling->hosts > 1 || (smuggling->hosts == 0 && !is_old))
        detail = "the request must have exactly one Host header";
    else if (smuggling->lengths > 1)
        detail = "the request has more than one Content-Length header";
    else if (smuggling->is_not_number)
        detail = "Content-Length must be a number of at most 19 digits, without a blank behind it";
    else if (smuggling->encodings > 0 && smuggling->lengths > 0)
        detail = "the request has both Transfer-Encoding and Content-Length";
    else if (smuggling->encodings > 1 || smuggling->is_not_chunked)
        detail = "Transfer-Encoding must be chunked, without a blank behind it";
    else if (smuggling->encodings > 0 && is_old)
        detail = "HTTP/1.0 does not define Transfer-Encoding";
    return (struct srv_rejection){ detail ? 400 : 0, detail };
}
