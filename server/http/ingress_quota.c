/* SPDX-License-Identifier: Apache-2.0 */
#include "http/ingress_quota.h"

#include <stdlib.h>
#include <string.h>

enum { HALF = SRV_INGRESS_TICK_BYTES / 2 };

struct srv_ingress_node { /* the root, an owner, or a session */
    struct srv_ingress_node *parent, *next, *first;
    int64_t children; /* child nodes; of a session: streams */
    char name[];
};

struct srv_ingress {
    struct srv_ingress_node *all;
    uint64_t tick;
    int64_t burst; /* most bytes that one stream can save up */
    int64_t open;  /* bytes left in the first-come half; negative = owed to the next tick */
};

static struct srv_ingress_node *node_create(struct srv_ingress_node *parent, const char *name) {
    const size_t size = strlen(name) + 1;
    struct srv_ingress_node *node = calloc(1, sizeof *node + size);
    if (!node)
        return NULL;
    memcpy(node->name, name, size);
    node->parent = parent;
    if (parent) {
        node->next = parent->first;
        parent->first = node;
        parent->children++;
    }
    return node;
}

static struct srv_ingress_node *find(struct srv_ingress_node *parent, const char *name) {
    struct srv_ingress_node *node = parent->first;
    while (node && strcmp(node->name, name) != 0)
        node = node->next;
    return node ? node : node_create(parent, name);
}

/* Frees the node and its ancestors as long as they have no children. The root stays. */
static void prune(struct srv_ingress_node *node) {
    while (node->parent && node->children == 0) {
        struct srv_ingress_node *parent = node->parent, **link = &parent->first;
        while (*link != node)
            link = &(*link)->next;
        *link = node->next;
        parent->children--;
        free(node);
        node = parent;
    }
}

struct srv_ingress *srv_ingress_create(size_t message_bytes) {
    struct srv_ingress *ingress = calloc(1, sizeof *ingress);
    if (!ingress)
        return NULL;
    ingress->all = node_create(NULL, "");
    ingress->open = HALF;
    ingress->burst = message_bytes > SRV_INGRESS_STREAM_BYTES ? (int64_t)message_bytes
                                                              : SRV_INGRESS_STREAM_BYTES;
    if (!ingress->all)
        srv_ingress_destroy(&ingress);
    return ingress;
}

void srv_ingress_destroy(struct srv_ingress **ingress) {
    if (*ingress)
        free((*ingress)->all);
    free(*ingress);
    *ingress = NULL;
}

void srv_ingress_tick(struct srv_ingress *ingress) {
    ingress->tick++;
    ingress->open = ingress->open > 0 ? HALF : ingress->open + HALF;
}

bool srv_ingress_open(struct srv_ingress *ingress, const char *owner, const char *session,
                      struct srv_ingress_stream *stream) {
    struct srv_ingress_node *above = find(ingress->all, owner);
    struct srv_ingress_node *node = above ? find(above, session) : NULL;
    if (!node) {
        if (above)
            prune(above);
        return false;
    }
    node->children++;
    *stream = (struct srv_ingress_stream){
        .ingress = ingress, .session = node, .tick = ingress->tick, .left = ingress->burst
    };
    return true;
}

void srv_ingress_close(struct srv_ingress_stream *stream) {
    if (!stream->ingress)
        return;
    stream->session->children--;
    prune(stream->session);
    stream->ingress = NULL;
}

/* Returns the stream with the quota of the current tick. */
static struct srv_ingress_stream renewed(const struct srv_ingress_stream *stream) {
    const struct srv_ingress *ingress = stream->ingress;
    const uint64_t ticks = ingress->tick - stream->tick;
    struct srv_ingress_stream now = *stream;
    if (ticks == 0)
        return now;
    const int64_t missing = ingress->burst - stream->left;
    now.left = ticks > (uint64_t)(missing / SRV_INGRESS_STREAM_BYTES)
                   ? ingress->burst
                   : stream->left + (int64_t)ticks * SRV_INGRESS_STREAM_BYTES;
    now.sure = 0;
    now.tick = ingress->tick;
    return now;
}

/* Returns the bytes left of its own part of the divided half. */
static int64_t sure_left(const struct srv_ingress_stream *stream) {
    int64_t part = HALF;
    for (const struct srv_ingress_node *node = stream->session; node; node = node->parent)
        part /= node->children;
    return part > stream->sure ? part - stream->sure : 0;
}

bool srv_ingress_has(const struct srv_ingress_stream *stream) {
    const struct srv_ingress_stream now = renewed(stream);
    return now.left > 0 && (now.ingress->open > 0 || sure_left(&now) > 0);
}

void srv_ingress_take(struct srv_ingress_stream *stream, size_t bytes) {
    *stream = renewed(stream);
    const int64_t size = (int64_t)bytes, sure = sure_left(stream);
    const int64_t own = size < sure ? size : sure;
    stream->left -= size;
    stream->sure += own;
    stream->ingress->open -= size - own;
}
