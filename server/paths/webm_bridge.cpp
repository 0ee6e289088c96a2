/* SPDX-License-Identifier: Apache-2.0 */
#include "paths/webm_bridge.h"

#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>

#include <ebml/EbmlHead.h>
#include <ebml/EbmlSubHead.h>
#include <ebml/EbmlVoid.h>
#include <ebml/StdIOCallback.h>
#include <matroska/KaxBlock.h>
#include <matroska/KaxCluster.h>
#include <matroska/KaxCues.h>
#include <matroska/KaxCuesData.h>
#include <matroska/KaxInfo.h>
#include <matroska/KaxInfoData.h>
#include <matroska/KaxSeekHead.h>
#include <matroska/KaxSegment.h>
#include <matroska/KaxTrackEntryData.h>
#include <matroska/KaxTrackVideo.h>
#include <matroska/KaxTracks.h>

using namespace libmatroska;

namespace {
const uint64_t SCALE_NS = 1000000;      /* times are in ms */
const uint64_t CLUSTER_NS = 5000000000; /* longest duration of a cluster */
/* Size limit of a cluster, unless one packet is larger. Clusters are assembled in memory. */
const size_t CLUSTER_BYTES = 4 << 20;
const uint64_t SEEK_BYTES = 96; /* reserved for the seek head */
} // namespace

struct srv_webm {
    std::unique_ptr<StdIOCallback> file;
    KaxSegment segment;
    KaxCues cues;
    EbmlVoid reserved;
    std::unique_ptr<KaxCluster> cluster;
    KaxTrackEntry *track = nullptr;
    uint64_t start_ns = 0; /* of the cluster */
    size_t cluster_bytes = 0;
    bool cluster_has_key = false;
    double fps = 30;
};

static void write_head(StdIOCallback &file) {
    EbmlHead head;
    GetChild<EDocType>(head).SetValue("webm");
    GetChild<EDocTypeVersion>(head).SetValue(4);
    GetChild<EDocTypeReadVersion>(head).SetValue(2);
    head.Render(file, true);
}

static void write_info(srv_webm &w, uint32_t frames) {
    auto &info = GetChild<KaxInfo>(w.segment);
    GetChild<KaxTimecodeScale>(info).SetValue(SCALE_NS);
    GetChild<KaxDuration>(info).SetPrecision(EbmlFloat::FLOAT_64);
    GetChild<KaxDuration>(info).SetValue(frames / w.fps * 1e9 / SCALE_NS);
    GetChild<KaxMuxingApp>(info).SetValueUTF8("libmatroska");
    GetChild<KaxWritingApp>(info).SetValueUTF8("splatd");
    info.Render(*w.file, true);
}

static void write_tracks(srv_webm &w, uint32_t width, uint32_t height) {
    auto &tracks = GetChild<KaxTracks>(w.segment);
    auto &track = GetChild<KaxTrackEntry>(tracks);
    track.SetGlobalTimecodeScale(SCALE_NS);
    GetChild<KaxTrackNumber>(track).SetValue(1);
    GetChild<KaxTrackUID>(track).SetValue(1);
    GetChild<KaxTrackType>(track).SetValue(track_video);
    GetChild<KaxTrackFlagLacing>(track).SetValue(0);
    GetChild<KaxTrackDefaultDuration>(track).SetValue(
        static_cast<uint64_t>(std::llround(1e9 / w.fps)));
    GetChild<KaxCodecID>(track).SetValue("V_VP9");
    auto &video = GetChild<KaxTrackVideo>(track);
    GetChild<KaxVideoPixelWidth>(video).SetValue(width);
    GetChild<KaxVideoPixelHeight>(video).SetValue(height);
    tracks.Render(*w.file);
    w.track = &track;
}

/* Adds an index entry for the cluster, which begins with a key frame. */
static void add_cue(srv_webm &w) {
    auto &point = AddNewChild<KaxCuePoint>(w.cues);
    GetChild<KaxCueTime>(point).SetValue(w.start_ns / SCALE_NS);
    auto &place = GetChild<KaxCueTrackPositions>(point);
    GetChild<KaxCueTrack>(place).SetValue(1);
    GetChild<KaxCueClusterPosition>(place).SetValue(w.segment.GetRelativePosition(*w.cluster));
}

static void write_cluster(srv_webm &w) {
    if (!w.cluster)
        return;
    KaxCues none;
    none.SetGlobalTimecodeScale(SCALE_NS);
    w.cluster->Render(*w.file, none);
    if (w.cluster_has_key)
        add_cue(w);
    w.cluster.reset();
}

/* Calls `action` and catches exceptions: libmatroska reports failed writes as exceptions. */
template <typename Action> static bool guarded(char *reason, Action action) {
    try {
        action();
        return true;
    } catch (const std::exception &e) {
        std::snprintf(reason, SRV_WEBM_REASON, "%s", e.what());
    } catch (...) {
        std::snprintf(reason, SRV_WEBM_REASON, "cannot write the file");
    }
    return false;
}

extern "C" struct srv_webm *srv_webm_create(const char *path, uint32_t width, uint32_t height,
                                            double fps, uint32_t frames,
                                            char reason[SRV_WEBM_REASON]) {
    srv_webm *webm = nullptr;
    bool ok = guarded(reason, [&] {
        webm = new srv_webm;
        webm->fps = fps;
        webm->file = std::make_unique<StdIOCallback>(path, MODE_CREATE);
        write_head(*webm->file);
        webm->segment.WriteHead(*webm->file, 8);
        webm->reserved.SetSize(SEEK_BYTES);
        webm->reserved.Render(*webm->file);
        webm->cues.SetGlobalTimecodeScale(SCALE_NS);
        write_info(*webm, frames);
        write_tracks(*webm, width, height);
    });
    if (!ok)
        srv_webm_destroy(&webm);
    return webm;
}

extern "C" bool srv_webm_add(struct srv_webm *webm, uint32_t i, const void *bytes, size_t size,
                             bool is_key, char reason[SRV_WEBM_REASON]) {
    return guarded(reason, [&] {
        srv_webm &w = *webm;
        uint64_t ns = static_cast<uint64_t>(std::llround(i * 1e3 / w.fps)) * SCALE_NS;
        if (is_key || ns - w.start_ns > CLUSTER_NS || w.cluster_bytes + size > CLUSTER_BYTES)
            write_cluster(w);
        if (!w.cluster) {
            w.cluster = std::make_unique<KaxCluster>();
            w.cluster->SetParent(w.segment);
            w.cluster->InitTimecode(ns / SCALE_NS, SCALE_NS);
            w.start_ns = ns;
            w.cluster_has_key = is_key;
            w.cluster_bytes = 0;
        }
        auto *data = static_cast<binary *>(const_cast<void *>(bytes));
        auto &block = AddNewChild<KaxSimpleBlock>(*w.cluster);
        block.SetParent(*w.cluster);
        /* The block copies the bytes and frees its buffer. */
        block.AddFrame(*w.track, ns, *new DataBuffer(data, size, nullptr, true), LACING_NONE);
        block.SetKeyframe(is_key);
        block.SetDiscardable(false);
        w.cluster_bytes += size;
    });
}

extern "C" bool srv_webm_finish(struct srv_webm *webm, char reason[SRV_WEBM_REASON]) {
    return guarded(reason, [&] {
        srv_webm &w = *webm;
        write_cluster(w);
        w.cues.Render(*w.file);
        uint64_t end = w.file->getFilePointer();
        KaxSeekHead seek;
        seek.IndexThis(GetChild<KaxInfo>(w.segment), w.segment);
        seek.IndexThis(GetChild<KaxTracks>(w.segment), w.segment);
        seek.IndexThis(w.cues, w.segment);
        w.reserved.ReplaceWith(seek, *w.file, true);
        w.segment.ForceSize(end - w.segment.GetElementPosition() - w.segment.HeadSize());
        w.segment.OverwriteHead(*w.file);
        w.file->close();
    });
}

extern "C" void srv_webm_destroy(struct srv_webm **webm) {
    delete *webm;
    *webm = nullptr;
}
