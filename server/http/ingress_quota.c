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
    /* Bytes left in the first-come halves; negative = owed to the next tick. */
    int64_t open[SRV_INGRESS_KINDS];
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

static struct srv_ingress_node *find_or_add(struct srv_ingress_node *parent, const char *name) {
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
    for (int kind = 0; kind < SRV_INGRESS_KINDS; kind++)
        ingress->open[kind] = HALF;
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
    for (int kind = 0; kind < SRV_INGRESS_KINDS; kind++)
        ingress->open[kind] = ingress->open[kind] > 0 ? HALF : ingress->open[kind] + HALF;
}

bool srv_ingress_open(struct srv_ingress *ingress, const char *owner, const char *session,
                      struct srv_ingress_stream *stream) {
    struct srv_ingress_node *above = find_or_add(ingress->all, owner);
    struct srv_ingress_node *node = above ? find_or_add(above, session) : NULL;
    if (!node) {
        if (above)
            prune(above);
        return false;
    }
    node->children++;
    *stream =
        (struct srv_ingress_stream){ .ingress = ingress, .session = node, .tick = ingress->tick };
    for (int kind = 0; kind < SRV_INGRESS_KINDS; kind++)
        stream->accounts[kind].left = ingress->burst;
    return true;
}

void srv_ingress_close(struct srv_ingress_stream *stream) {
    if (!stream->ingress)
        return;
    stream->session->children--;
    prune(stream->session);
    stream->ingress = NULL;
}

/* Fills the account after so many ticks. */
static void renew(struct srv_ingress_account *account, int64_t burst, uint64_t ticks) {
    const int64_t missing = burst - account->left;
    account->left = ticks > (uint64_t)(missing / SRV_INGRESS_STREAM_BYTES)
                        ? burst
                        : account->left + (int64_t)ticks * SRV_INGRESS_STREAM_BYTES;
    account->sure = 0;
}

/* Returns the stream with the quotas of the current tick. */
static struct srv_ingress_stream renewed(const struct srv_ingress_stream *stream) {
    const struct srv_ingress *ingress = stream->ingress;
    const uint64_t ticks = ingress->tick - stream->tick;
    struct srv_ingress_stream now = *stream;
    for (int kind = 0; ticks > 0 && kind < SRV_INGRESS_KINDS; kind++)
        renew(&now.accounts[kind], ingress->burst, ticks);
    now.tick = ingress->tick;
    return now;
}

/* Returns the bytes left of its own part of the divided half. */
static int64_t sure_left(const struct srv_ingress_stream *stream, enum srv_ingress_kind kind) {
    const int64_t sure = stream->accounts[kind].sure;
    int64_t part = HALF;
    for (const struct srv_ingress_node *node = stream->session; node; node = node->parent)
        part /= node->children;
    return part > sure ? part - sure : 0;
}

bool srv_ingress_has(const struct srv_ingress_stream *stream, enum srv_ingress_kind kind) {
    const struct srv_ingress_stream now = renewed(stream);
    return now.accounts[kind].left > 0 &&
           (now.ingress->open[kind] > 0 || sure_left(&now, kind) > 0);
}

void srv_ingress_charge(struct srv_ingress_stream *stream, enum srv_ingress_kind kind,
                        size_t bytes) {
    *stream = renewed(stream);
    const int64_t size = (int64_t)bytes, sure = sure_left(stream, kind);
    const int64_t own = size < sure ? size : sure;
    stream->accounts[kind].left -= size;
    stream->accounts[kind].sure += own;
    stream->ingress->open[kind] -= size - own;
}
