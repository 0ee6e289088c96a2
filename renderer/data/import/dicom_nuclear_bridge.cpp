// SPDX-License-Identifier: Apache-2.0
//
// Nuclear medicine: FrameIncrementPointer names vectors with a number for each frame, from 1: its
// slice, detector, energy window, phase, …
#include <cmath>

#include "data/import/dicom_tags.h"

namespace {

/* Vectors: elements of group 0054. */
enum : uint16_t {
    ENERGY = 0x0010,
    DETECTOR = 0x0020,
    PHASE = 0x0030,
    ROTATION = 0x0050,
    INTERVAL = 0x0060,
    SLOT = 0x0070,
    SLICE = 0x0080,
    VIEW = 0x0090,
    TIME_SLICE = 0x0100
};

const uint16_t times[] = { PHASE, ROTATION, INTERVAL, SLOT, TIME_SLICE, VIEW };

std::string window_name(const gdcm::DataSet &window, size_t number) {
    const std::string name = dicom_text(window, 0x0054, 0x0018);
    return name.empty() ? "energy window " + std::to_string(number) : name;
}

} // namespace

dicom_nuclear::dicom_nuclear(const gdcm::DataSet &set)
    : detectors(dicom_sequence(set, 0x0054, 0x0022)) {
    for (uint16_t vector :
         { SLICE, DETECTOR, ENERGY, PHASE, TIME_SLICE, ROTATION, INTERVAL, SLOT, VIEW })
        vectors[vector] = dicom_values<uint16_t>(set, 0x0054, vector);
    read_phases(set);
    read_slots(set);
    const auto windows = dicom_sequence(set, 0x0054, 0x0012);
    for (size_t i = 1; windows && i <= windows->GetNumberOfItems(); i++)
        window_names.push_back(window_name(windows->GetItem(i).GetNestedDataSet(), i));
}

/* Phases from the first one whose duration is missing on have no time. */
void dicom_nuclear::read_phases(const gdcm::DataSet &set) {
    const auto items = dicom_sequence(set, 0x0054, 0x0032);
    double at = 0;
    for (size_t i = 1; items && i <= items->GetNumberOfItems(); i++) {
        const gdcm::DataSet &item = items->GetItem(i).GetNestedDataSet();
        const double duration = dicom_number(item, 0x0018, 0x1242) / 1000;
        const double delay = dicom_number(item, 0x0054, 0x0036) / 1000;
        if (!(duration > 0))
            return;
        at += i > 1 && delay > 0 ? delay : 0;
        phases.push_back({ at, duration });
        at += duration * dicom_value<uint16_t>(item, 0x0054, 0x0033);
    }
}

void dicom_nuclear::read_slots(const gdcm::DataSet &set) {
    const gdcm::DataSet data = dicom_item(dicom_item(set, 0x0054, 0x0062), 0x0054, 0x0063);
    const auto items = dicom_sequence(data, 0x0054, 0x0072);
    double at = 0;
    for (size_t i = 1; items && i <= items->GetNumberOfItems(); i++) {
        at += dicom_number(items->GetItem(i).GetNestedDataSet(), 0x0054, 0x0073) / 1000;
        slot_ends.push_back(at);
    }
    slot_time = dicom_number(data, 0x0018, 0x1063) / 1000; /* FrameTime */
}

/* The number that a vector has for a frame; 0 if there is no such vector. */
unsigned dicom_nuclear::number(uint16_t vector, uint32_t index) const {
    const std::vector<uint16_t> &numbers = vectors.at(vector);
    return index < numbers.size() ? numbers[index] : 0;
}

/* Seconds since the first frame, or since the heartbeat, or NaN. */
double dicom_nuclear::time_of(uint32_t index) const {
    const unsigned own = number(PHASE, index), slice = number(TIME_SLICE, index),
                   slot = number(SLOT, index);
    if (own >= 1 && own <= phases.size()) {
        const double at =
            phases[own - 1].start + phases[own - 1].duration * (slice > 0 ? slice - 1 : 0);
        if (std::isfinite(at))
            return at;
    }
    if (slot <= 1)
        return slot == 1 ? 0 : NAN;
    const double at = slot - 1 <= slot_ends.size() ? slot_ends[slot - 2] : NAN;
    return at > 0 && std::isfinite(at) ? at : slot_time * (slot - 1);
}

const gdcm::DataSet &dicom_nuclear::detector(uint32_t index) const {
    static const gdcm::DataSet none;
    const size_t own = number(DETECTOR, index),
                 count = detectors ? detectors->GetNumberOfItems() : 0;
    if (count == 0)
        return none;
    return detectors->GetItem(own >= 1 && own <= count ? own : 1).GetNestedDataSet();
}

bool dicom_nuclear::fill(uint32_t index, dicom_frame *frame, dicom_tuple *time,
                         dicom_tuple *other) const {
    const unsigned slice = number(SLICE, index), window = number(ENERGY, index),
                   own = number(DETECTOR, index);
    bool has_time = false;
    for (uint16_t vector : times)
        has_time |= number(vector, index) > 0;
    if (!slice && !has_time && !window && !own)
        return false;
    frame->slot = slice;
    frame->is_assumed = slice && frame->spacing[2] == 0;
    if (slice)
        dicom_move(frame, (slice - 1) * (frame->spacing[2] != 0 ? frame->spacing[2] : 1));
    for (uint16_t vector : times)
        if (has_time)
            time->push_back(number(vector, index));
    frame->keys[DICOM_KEY_DELAY] = time_of(index);
    if (window || own) {
        const size_t chosen = window ? window : 1;
        *other = { window, own };
        const std::string name =
            (chosen <= window_names.size() ? window_names[chosen - 1] : window_name({}, chosen)) +
            (own ? ", detector " + std::to_string(own) : std::string());
        dicom_copy(frame->texts[DICOM_TEXT_OTHER], DICOM_TEXT_BYTES, name);
    }
    return true;
}
