// SPDX-License-Identifier: Apache-2.0
//
// Nuclear medicine: FrameIncrementPointer names vectors with a number for each frame, from 1: its
// slice, detector, energy window, phase, …
#include <cmath>
#include <string>

#include "import/dicom_tags.h"

namespace {

enum { SLICE = 0x0080, DETECTOR = 0x0020, ENERGY = 0x0010, PHASE = 0x0030, TIME_SLICE = 0x0100 };

/* The number that a vector has for a frame; 0 if there is no such vector. */
unsigned number_in(const gdcm::DataSet &set, uint16_t vector, uint32_t index) {
    const std::vector<uint16_t> numbers = dicom_values<uint16_t>(set, 0x0054, vector);
    return index < numbers.size() ? numbers[index] : 0;
}

/* Seconds between the first frame and this phase and slice of time, or NaN. */
double dynamic_time(const gdcm::DataSet &set, unsigned phase, unsigned time_slice) {
    const auto phases = dicom_sequence(set, 0x0054, 0x0032);
    double at = 0;
    if (!phases || phase < 1 || phase > phases->GetNumberOfItems())
        return NAN;
    for (unsigned i = 1; i <= phase; i++) {
        const gdcm::DataSet &item = phases->GetItem(i).GetNestedDataSet();
        const double duration = dicom_number(item, 0x0018, 0x1242);
        const double delay = dicom_number(item, 0x0054, 0x0036);
        const double frames = dicom_value<uint16_t>(item, 0x0054, 0x0033);
        if (!(duration > 0))
            return NAN;
        at += i > 1 && delay > 0 ? delay : 0;
        at += duration * (i < phase ? frames : time_slice > 0 ? time_slice - 1 : 0);
    }
    return at / 1000;
}

/* Seconds since the heartbeat of a time slot, or NaN. */
double gated_time(const gdcm::DataSet &set, unsigned slot) {
    const gdcm::DataSet data = dicom_item(dicom_item(set, 0x0054, 0x0062), 0x0054, 0x0063);
    double at = 0;
    for (unsigned i = 1; i < slot; i++)
        at += dicom_number(dicom_item(data, 0x0054, 0x0072, i), 0x0054, 0x0073) / 1000;
    const double each = dicom_number(data, 0x0018, 0x1063) / 1000; /* FrameTime */
    return slot < 1 ? NAN : std::isfinite(at) && at > 0 ? at : slot == 1 ? 0 : each * (slot - 1);
}

std::string window_name(const gdcm::DataSet &set, unsigned number) {
    const std::string name = dicom_text(dicom_item(set, 0x0054, 0x0012, number), 0x0054, 0x0018);
    return name.empty() ? "energy window " + std::to_string(number) : name;
}

} // namespace

gdcm::DataSet dicom_detector(const gdcm::DataSet &set, uint32_t index) {
    const unsigned number = number_in(set, DETECTOR, index);
    const gdcm::DataSet own = dicom_item(set, 0x0054, 0x0022, number ? number : 1);
    return own.IsEmpty() ? dicom_item(set, 0x0054, 0x0022) : own;
}

bool dicom_fill_nuclear(const gdcm::DataSet &set, uint32_t index, dicom_frame *frame) {
    static const uint16_t times[] = { PHASE, 0x0050, 0x0060, 0x0070, TIME_SLICE, 0x0090 };
    const unsigned slice = number_in(set, SLICE, index), window = number_in(set, ENERGY, index),
                   detector = number_in(set, DETECTOR, index);
    const double most = 4096; /* four vectors at most, so that the number stays exact */
    double time = 0;
    bool has_time = false;
    for (uint16_t vector : times) {
        const unsigned number = number_in(set, vector, index);
        if (number)
            time = time * most + number;
        has_time |= number > 0;
    }
    if (!slice && !has_time && !window && !detector)
        return false;
    frame->slot = slice;
    frame->is_assumed = slice && frame->spacing[2] == 0;
    if (slice)
        dicom_move(frame, (slice - 1) * (frame->spacing[2] != 0 ? frame->spacing[2] : 1));
    if (has_time)
        frame->keys[DICOM_KEY_PHASE] = time;
    const double dynamic =
        dynamic_time(set, number_in(set, PHASE, index), number_in(set, TIME_SLICE, index));
    const double gated = gated_time(set, number_in(set, 0x0070, index));
    frame->keys[DICOM_KEY_DELAY] = std::isfinite(dynamic) ? dynamic : gated;
    if (window || detector) {
        frame->keys[DICOM_KEY_OTHER] = window * 65536.0 + detector;
        const std::string name =
            window_name(set, window ? window : 1) +
            (detector ? ", detector " + std::to_string(detector) : std::string());
        dicom_copy(frame->texts[DICOM_TEXT_OTHER], DICOM_TEXT_BYTES, name);
    }
    return true;
}
