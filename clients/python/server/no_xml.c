/* SPDX-License-Identifier: Apache-2.0
 *
 * Stands in for libxml2 in the wheel. libnetcdf links libxml2 for DAP4, a protocol for remote
 * files, which the importer never uses; libxml2 would bring 33 MB of ICU. Each function fails as
 * libxml2 does for a document that is not XML. no_xml.map has the versions of the symbols.
 */
#include <stdlib.h>

#define EXPORTED __attribute__((visibility("default")))

EXPORTED void (*xmlFree)(void *memory) = free;

EXPORTED void *xmlReadMemory(const char *text, int size, const char *url, const char *encoding,
                             int options) {
    (void)text, (void)size, (void)url, (void)encoding, (void)options;
    return NULL;
}

EXPORTED void *xmlDocGetRootElement(const void *document) {
    (void)document;
    return NULL;
}

EXPORTED void *xmlGetProp(const void *node, const unsigned char *name) {
    (void)node, (void)name;
    return NULL;
}

EXPORTED void *xmlNodeGetContent(const void *node) {
    (void)node;
    return NULL;
}

EXPORTED void *xmlNodeListGetString(void *document, const void *list, int in_line) {
    (void)document, (void)list, (void)in_line;
    return NULL;
}

EXPORTED void xmlFreeDoc(void *document) {
    (void)document;
}

EXPORTED void xmlCleanupParser(void) {
}
