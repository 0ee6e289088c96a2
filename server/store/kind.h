/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_STORE_KIND_H
#define SRV_STORE_KIND_H

/* The kinds of records. */
enum srv_kind {
    SRV_KIND_VOLUME,
    SRV_KIND_SESSION,
    SRV_KIND_VIEW,
    SRV_KIND_PRESET,
    SRV_KIND_PATH,
    SRV_KIND_CLOCK, /* for how long daemons ran with this store */
    SRV_KINDS
};
enum { SRV_STORE_ID_MAX = 127 }; /* bytes of an id, without the NUL */

#endif
