// SPDX-License-Identifier: Apache-2.0
//
// What a file says about each of its frames: functional groups, of the frame or shared by all, or
// else elements of the file itself; vectors of nuclear medicine; offsets of a dose.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numeric>

#include "data/import/dicom_tags.h"

namespace {

struct groups { /* the functional groups of one frame */
    const gdcm::DataSet &file;
    gdcm::DataSet own, shared;

    /* The group in which the frame, or else all frames, have this; it may be empty. */
    gdcm::DataSet lookup(uint16_t group, uint16_t element) const {
        const gdcm::DataSet of_frame = dicom_item(own, group, element);
        return of_frame.IsEmpty() ? dicom_item(shared, group, element) : of_frame;
    }
};

using numbers = std::vector<double>;

void set_key(dicom_frame &frame, dicom_key key, double number, double factor = 1) {
    if (std::isfinite(number) && std::isnan(frame.keys[key]))
        frame.keys[key] = number * factor;
}

/* Days since 1970-01-01 of a date (Howard Hinnant, "chrono-compatible low-level date algorithms").
 */
double days_of(int year, int month, int day) {
    year -= month <= 2;
    const int era = year / 400, of_era = year - era * 400;
    const int of_year = (153 * (month + (month > 2 ? -3 : 9)) + 2) / 5 + day - 1;
    return era * 146097.0 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719468;
}

/* Seconds of a time zone "+HHMM" or "-HHMM" ahead of UTC. */
double zone_of(const std::string &text) {
    int hour = 0, minute = 0;
    if (text.empty() || sscanf(text.c_str() + 1, "%2d%2d", &hour, &minute) < 1)
        return 0;
    return (text[0] == '-' ? -1 : 1) * (hour * 3600.0 + minute * 60.0);
}

/* Seconds of "YYYYMMDDHHMMSS.FFFFFF+HHMM" since 1970, or NaN; what follows the month may be
 * missing. A time without a zone is taken as UTC, since a series has one zone if it names none. */
double seconds_of(const std::string &text) {
    int year = 0, month = 1, day = 1, hour = 0, minute = 0;
    double second = 0;
    const size_t end = std::min(text.find_first_of("+-"), text.size());
    const std::string local = text.substr(0, end);
    if (sscanf(local.c_str(), "%4d%2d%2d%2d%2d%lf", &year, &month, &day, &hour, &minute, &second) <
            3 ||
        year < 1 || month < 1 || month > 12)
        return NAN;
    return days_of(year, month, day) * 86400 + hour * 3600 + minute * 60 + second -
           zone_of(text.substr(end));
}

const double DAY = 86400;

/* Without the marks that old files write: "2001.02.03", "10:20:30". */
std::string digits_of(const gdcm::DataSet &file, uint16_t element, const char *marks) {
    std::string text = dicom_text(file, 0x0008, element);
    for (size_t at; (at = text.find_first_of(marks)) != std::string::npos;)
        text.erase(at, 1);
    return text;
}

/* A time of the file with its date. Without a date it is a time of day: less than DAY. */
double clock_of(const gdcm::DataSet &file, uint16_t date, uint16_t time) {
    const std::string day = digits_of(file, date, "."), text = digits_of(file, time, ":");
    return text.empty() ? NAN : seconds_of((day.size() == 8 ? day : "19700101") + text);
}

/* The time of the acquisition. If only the content has a date, it is the nearest such time. */
double acquisition_of(const gdcm::DataSet &file) {
    const double clock = clock_of(file, 0x0022, 0x0032), content = clock_of(file, 0x0023, 0x0033);
    if (!(clock < DAY) || !(content >= DAY))
        return clock;
    return clock + DAY * std::round((content - clock) / DAY);
}

bool copy_numbers(const numbers &from, size_t count, double *out) {
    if (from.size() < count)
        return false;
    std::copy_n(from.begin(), count, out);
    return true;
}

bool set_directions(const numbers &cosines, dicom_frame &frame) {
    if (!copy_numbers(cosines, 6, frame.along[0]))
        return false;
    for (auto &along : frame.along) {
        const double length = std::sqrt(std::inner_product(along, along + 3, along, 0.0));
        if (!(length > 0.5 && length < 2))
            return false;
        for (double &number : along)
            number /= length;
    }
    return std::fabs(std::inner_product(frame.along[0], frame.along[0] + 3, frame.along[1], 0.0)) <
           0.99;
}

/* Millimetres per column and row of an ultrasound region; empty if it has other units. */
numbers region_scale(const gdcm::DataSet &region) {
    const int centimetres = 3;
    const double across = 10 * std::fabs(dicom_value<double>(region, 0x0018, 0x602c));
    const double down = 10 * std::fabs(dicom_value<double>(region, 0x0018, 0x602e));
    const bool is_length = dicom_value<uint16_t>(region, 0x0018, 0x6024) == centimetres &&
                           dicom_value<uint16_t>(region, 0x0018, 0x6026) == centimetres;
    const bool is_known = across > 0 && down > 0 && std::isfinite(across + down);
    return is_length && is_known ? numbers{ across, down } : numbers();
}

/* The scale of the first region that has one. *is_mixed: other regions have another scale, or none.
 */
numbers regions_scale(const gdcm::DataSet &set, bool *is_mixed) {
    const auto regions = dicom_sequence(set, 0x0018, 0x6011);
    const size_t count = regions ? regions->GetNumberOfItems() : 0;
    numbers scale;
    *is_mixed = false;
    for (size_t i = 1; i <= count && scale.empty(); i++)
        scale = region_scale(regions->GetItem(i).GetNestedDataSet());
    for (size_t i = 1; i <= count && !scale.empty(); i++) {
        const numbers other = region_scale(regions->GetItem(i).GetNestedDataSet());
        *is_mixed |= other.empty() || std::fabs(other[0] - scale[0]) > 1e-3 * scale[0] ||
                     std::fabs(other[1] - scale[1]) > 1e-3 * scale[1];
    }
    return scale;
}

/* Distances between pixels as a file without functional groups gives them. */
void fill_plain_spacing(const gdcm::DataSet &set, dicom_frame &frame) {
    static const uint16_t tags[][2] = {
        { 0x0028, 0x0030 }, /* PixelSpacing */
        { 0x0018, 0x2010 }, /* NominalScannedPixelSpacing */
        { 0x0018, 0x1164 }, /* ImagerPixelSpacing */
    };
    for (const auto &tag : tags) {
        const numbers pair = dicom_numbers(set, tag[0], tag[1]);
        if (pair.size() < 2 || !(pair[0] > 0) || !(pair[1] > 0))
            continue;
        frame.spacing[0] = pair[1];
        frame.spacing[1] = pair[0];
        return;
    }
    bool is_mixed;
    if (copy_numbers(regions_scale(set, &is_mixed), 2, frame.spacing)) {
        frame.has_regions = is_mixed;
        return;
    }
    const numbers ratio = dicom_numbers(set, 0x0028, 0x0034); /* of height and width */
    frame.is_ratio = ratio.size() == 2 && ratio[0] > 0 && ratio[1] > 0;
    if (frame.is_ratio) {
        frame.spacing[0] = 1;
        frame.spacing[1] = ratio[0] / ratio[1];
    }
}

void fill_spacing(const groups &in, dicom_frame &frame) {
    const gdcm::DataSet measures = in.lookup(0x0028, 0x9110);
    fill_plain_spacing(measures.IsEmpty() ? in.file : measures, frame);
    const gdcm::DataSet &set = measures.IsEmpty() ? in.file : measures;
    const double between = dicom_number(set, 0x0018, 0x0088);
    const double thick = dicom_number(set, 0x0018, 0x0050);
    frame.is_spaced = std::isfinite(between) && between != 0;
    frame.spacing[2] = std::isfinite(between) && between != 0 ? between : thick > 0 ? thick : 0;
}

/* True if the functional groups or the file have a place; `of_all` is set if the file gives only
 * one for all frames. */
bool fill_place(const groups &in, const gdcm::DataSet &detector, dicom_frame &frame, bool &of_all) {
    const gdcm::DataSet &file = dicom_text(detector, 0x0020, 0x0032).empty() ? in.file : detector;
    const gdcm::DataSet position = in.lookup(0x0020, 0x9113),
                        orientation = in.lookup(0x0020, 0x9116);
    const gdcm::DataSet in_volume = in.lookup(0x0020, 0x930e);
    of_all = false;
    if (!in_volume.IsEmpty())
        return copy_numbers(dicom_values<double>(in_volume, 0x0020, 0x9301), 3, frame.position) &&
               set_directions(dicom_values<double>(in.lookup(0x0020, 0x930f), 0x0020, 0x9302),
                              frame);
    of_all = position.IsEmpty();
    const dicom_gap gap = dicom_gap_of(in.file);
    if (gap != DICOM_NO_GAP) { /* a note says so */
        frame.along[0][0] = frame.along[1][1] = 1;
        frame.position[2] = dicom_number(in.file, 0x0020, 0x1041);
        return gap == DICOM_ONLY_LOCATION ||
               copy_numbers(dicom_numbers(in.file, 0x0020, 0x0032), 3, frame.position);
    }
    const bool has_position =
        copy_numbers(dicom_numbers(of_all ? file : position, 0x0020, 0x0032), 3, frame.position);
    const numbers cosines =
        dicom_numbers(orientation.IsEmpty() ? file : orientation, 0x0020, 0x0037);
    const bool has_directions = set_directions(cosines, frame);
    frame.is_turned_wrong = has_position && !has_directions && cosines.size() >= 6;
    return has_position && has_directions;
}

void unit_of_code(const gdcm::DataSet &mapping, dicom_frame &frame) {
    const std::string code = dicom_text(dicom_item(mapping, 0x0040, 0x08ea), 0x0008, 0x0100);
    const bool is_none = code == "1" || code == "{no_units}" || code == "no units";
    dicom_copy(frame.unit, sizeof frame.unit, is_none ? "" : code == "[hnsf'U]" ? "HU" : code);
}

std::string unit_of_file(const gdcm::DataSet &set) {
    static const std::map<std::string, std::string> names = {
        { "BQML", "Bq/ml" },   { "CNTS", "counts" },     { "PROPCNTS", "" }, { "GML", "g/ml" },
        { "NONE", "" },        { "PROPCPS", "" },        { "CPS", "1/s" },   { "PCNT", "%" },
        { "CM2ML", "cm²/ml" }, { "MLMING", "ml/min/g" }, { "MLG", "ml/g" },  { "1CM", "1/cm" },
    };
    const std::string unit = dicom_text(set, 0x0054, 0x1001);
    const auto found = names.find(unit);
    return found == names.end() ? unit : found->second;
}

/* Values of a CT are Hounsfield units, but not those of an overview, which sums along its beams;
 * nor, unless the file says so, those of an image that was derived from others. Of other modalities
 * a "HU" is a mistake. */
bool is_hounsfield(const groups &in, const std::string &modality, const std::string &type) {
    const std::string kind = dicom_text(in.file, 0x0008, 0x0008);
    const std::string flavour = dicom_text(in.lookup(0x0018, 0x9329), 0x0008, 0x9007);
    const bool is_overview = kind.find("LOCALIZER") != std::string::npos ||
                             flavour.find("LOCALIZER") != std::string::npos;
    const bool is_derived = kind.compare(0, 7, "DERIVED") == 0;
    return modality == "CT" && !is_overview && (type == "HU" || !is_derived);
}

/* Fills in how stored numbers become values: by the dose, the rescaling, or the mapping to the real
 * world, in this order; without them values equal the stored numbers. */
void fill_values(const groups &in, dicom_frame &frame) {
    const std::string modality = dicom_text(in.file, 0x0008, 0x0060);
    const gdcm::DataSet own = in.lookup(0x0028, 0x9145);
    const gdcm::DataSet &transform = own.IsEmpty() ? in.file : own;
    const gdcm::DataSet of_groups = in.lookup(0x0040, 0x9096);
    const gdcm::DataSet world =
        of_groups.IsEmpty() ? dicom_item(in.file, 0x0040, 0x9096) : of_groups;
    const double dose = dicom_number(in.file, 0x3004, 0x000e);
    const double slope = dicom_number(transform, 0x0028, 0x1053);
    const double intercept = dicom_number(transform, 0x0028, 0x1052);
    const double world_slope = dicom_value<double>(world, 0x0040, 0x9225);
    const double world_intercept = dicom_value<double>(world, 0x0040, 0x9224);
    const std::string type = dicom_text(transform, 0x0028, 0x1054);
    const bool is_dose = modality == "RTDOSE" && std::isfinite(dose);
    /* Some objects must have a transformation, and it changes nothing: the mapping counts. */
    const bool is_same = (slope == 1 || std::isnan(slope)) &&
                         (intercept == 0 || std::isnan(intercept)) &&
                         (type.empty() || type == "US") && std::isfinite(world_slope);
    const bool is_scaled = !is_same && (std::isfinite(slope) || std::isfinite(intercept));
    frame.slope = 1;
    frame.intercept = 0;
    if (is_dose) {
        frame.slope = dose;
        dicom_copy(frame.unit, sizeof frame.unit,
                   dicom_text(in.file, 0x3004, 0x0002) == "GY" ? "Gy" : "");
    } else if (is_scaled) {
        frame.slope = std::isfinite(slope) ? slope : 1;
        frame.intercept = std::isfinite(intercept) ? intercept : 0;
        if (frame.slope == world_slope && frame.intercept == world_intercept)
            unit_of_code(world, frame);
    } else if (std::isfinite(world_slope) && world_slope != 0) {
        frame.slope = world_slope;
        frame.intercept = std::isfinite(world_intercept) ? world_intercept : 0;
        unit_of_code(world, frame);
    }
    if (is_dose || frame.unit[0])
        return;
    if (!type.empty() && type != "US" && type != "HU")
        dicom_copy(frame.unit, sizeof frame.unit, type);
    else if ((type == "HU" || (type.empty() && is_scaled)) && is_hounsfield(in, modality, type))
        dicom_copy(frame.unit, sizeof frame.unit, "HU");
    else if (modality == "PT")
        dicom_copy(frame.unit, sizeof frame.unit, unit_of_file(in.file));
}

/* Where the third value of a list begins. */
size_t third_of(const std::string &list) {
    const size_t first = list.find('\\');
    const size_t at = first == std::string::npos ? first : list.find('\\', first + 1);
    return at == std::string::npos ? at : at + 1;
}

/* The third value of a type, such as "ORIGINAL\PRIMARY\VOLUME\NONE": what the image shows. */
std::string flavour_of(const groups &in) {
    static const uint16_t sequences[][2] = {
        { 0x0018, 0x9226 },
        { 0x0018, 0x9329 },
        { 0x0018, 0x9751 },
        { 0x0040, 0x9092 },
    };
    for (const auto &tag : sequences) {
        const gdcm::DataSet type = in.lookup(tag[0], tag[1]);
        const std::string part = dicom_text(type, 0x0008, 0x9208); /* ComplexImageComponent */
        const std::string text = dicom_text(type, 0x0008, 0x9007);
        std::vector<std::string> words(1);
        for (char c : text)
            if (c == '\\')
                words.emplace_back();
            else
                words.back() += c;
        std::string name = words.size() > 2 ? words[2] : "";
        if (words.size() > 3 && words[3] != "NONE" && words[3] != name)
            name += (name.empty() ? "" : " ") + words[3];
        if (!part.empty() && part != "MIXED")
            name += (name.empty() ? "" : " ") + part;
        if (!name.empty())
            return name;
    }
    const std::string type = dicom_text(in.file, 0x0008, 0x0008); /* "ORIGINAL\\PRIMARY\\M\\ND" */
    const size_t at = third_of(type);
    if (at != std::string::npos) {
        std::string name = type.substr(at);
        std::replace(name.begin(), name.end(), '\\', ' ');
        return name;
    }
    return dicom_text(in.lookup(0x0018, 0x9807), 0x0018, 0x9808); /* of ultrasound */
}

std::string direction_of(const groups &in) {
    const numbers n =
        dicom_gradient(in.file, dicom_item(in.lookup(0x0018, 0x9117), 0x0018, 0x9076));
    char text[DICOM_TEXT_BYTES];
    if (n.size() < 3)
        return "";
    snprintf(text, sizeof text, "(%.3g, %.3g, %.3g)", n[0] + 0.0, n[1] + 0.0, n[2] + 0.0);
    return text;
}

void set_text(dicom_frame &frame, dicom_trait text, const std::string &value) {
    std::string line = value;
    std::replace(line.begin(), line.end(), '\\', ' ');
    dicom_copy(frame.texts[text], sizeof frame.texts[text], line);
}

/* What the image shows, in words, where its frames or the files of its series may differ in it. */
void fill_texts(const groups &in, dicom_frame &frame) {
    static const struct {
        dicom_trait text;
        uint16_t group, element;
    } plain[] = {
        { DICOM_TEXT_KERNEL, 0x0018, 0x1210 },      { DICOM_TEXT_FILTER, 0x0018, 0x1160 },
        { DICOM_TEXT_METHOD, 0x0054, 0x1103 },      { DICOM_TEXT_CORRECTION, 0x0028, 0x0051 },
        { DICOM_TEXT_AGENT, 0x0018, 0x0010 },       { DICOM_TEXT_COIL, 0x0018, 0x1250 },
        { DICOM_TEXT_DESCRIPTION, 0x0008, 0x103e },
    };
    for (const auto &one : plain)
        set_text(frame, one.text,
                 dicom_words(in.file, dicom_text(in.file, one.group, one.element)));
    const std::string derivation = dicom_text(in.file, 0x0008, 0x2111);
    if (!derivation.empty())
        set_text(frame, DICOM_TEXT_DESCRIPTION, dicom_words(in.file, derivation));
    const std::string kernel = dicom_text(in.lookup(0x0018, 0x9314), 0x0018, 0x1210);
    if (!kernel.empty())
        set_text(frame, DICOM_TEXT_KERNEL, kernel);
    const std::string type = dicom_text(in.file, 0x0008, 0x0008);
    const size_t end = third_of(type);
    set_text(frame, DICOM_TEXT_ORIGIN, end == std::string::npos ? type : type.substr(0, end - 1));
    if (!frame.segment)
        set_text(frame, DICOM_TEXT_FLAVOUR, flavour_of(in));
    set_text(frame, DICOM_TEXT_QUANTITY, dicom_text(in.lookup(0x0040, 0x9096), 0x0040, 0x9210));
    set_text(frame, DICOM_TEXT_UNIT, frame.unit);
    set_text(frame, DICOM_TEXT_DIRECTION, direction_of(in));
}

void fill_segment(const groups &in, dicom_frame &frame) {
    const double number = dicom_value<uint16_t>(in.lookup(0x0062, 0x000a), 0x0062, 0x000b);
    const double most = dicom_value<uint16_t>(in.file, 0x0062, 0x000e);
    const std::string type = dicom_text(in.file, 0x0062, 0x0001);
    if (!(number > 0))
        return;
    frame.segment = static_cast<uint32_t>(number);
    frame.keys[DICOM_KEY_FLAVOUR] = number;
    if (type == "FRACTIONAL" && most > 0)
        frame.slope = 1 / most;
    set_text(frame, DICOM_TEXT_FLAVOUR, "segment " + std::to_string(frame.segment));
    const auto segments = dicom_sequence(in.file, 0x0062, 0x0002);
    for (size_t i = 1; segments && i <= segments->GetNumberOfItems(); i++) {
        const gdcm::DataSet &segment = segments->GetItem(i).GetNestedDataSet();
        const std::string label = dicom_text(segment, 0x0062, 0x0005);
        if (dicom_value<uint16_t>(segment, 0x0062, 0x0004) == number && !label.empty())
            set_text(frame, DICOM_TEXT_FLAVOUR, dicom_words(in.file, label));
    }
}

void fill_time(const groups &in, dicom_frame &frame) {
    const gdcm::DataSet content = in.lookup(0x0020, 0x9111), heart = in.lookup(0x0018, 0x9118);
    set_key(frame, DICOM_KEY_PHASE, dicom_value<uint32_t>(content, 0x0020, 0x9128));
    set_key(frame, DICOM_KEY_DELAY,
            dicom_value<double>(in.lookup(0x0020, 0x9310), 0x0020, 0x930d)); /* [s] */
    set_key(frame, DICOM_KEY_DELAY, dicom_value<double>(heart, 0x0020, 0x9153), 1e-3);
    set_key(frame, DICOM_KEY_DELAY, dicom_value<double>(heart, 0x0020, 0x9252), 1e-3);
    set_key(frame, DICOM_KEY_PERCENT, dicom_value<float>(heart, 0x0020, 0x9241));
    set_key(frame, DICOM_KEY_ACQUISITION, dicom_value<uint16_t>(content, 0x0020, 0x9156));
    set_key(frame, DICOM_KEY_CLOCK, seconds_of(dicom_text(content, 0x0018, 0x9151)));
    set_key(frame, DICOM_KEY_CLOCK, seconds_of(dicom_text(content, 0x0018, 0x9074)));
    /* Of a file that is one slice. */
    set_key(frame, DICOM_KEY_PHASE, dicom_number(in.file, 0x0020, 0x0100));
    set_key(frame, DICOM_KEY_PERCENT, dicom_value<float>(in.file, 0x0020, 0x9241));
    set_key(frame, DICOM_KEY_DELAY, dicom_number(in.file, 0x0018, 0x1060), 1e-3);
    set_key(frame, DICOM_KEY_DELAY, dicom_value<double>(in.file, 0x0020, 0x9153), 1e-3);
    set_key(frame, DICOM_KEY_DELAY, dicom_number(in.file, 0x0054, 0x1300), 1e-3);
    set_key(frame, DICOM_KEY_CLOCK, seconds_of(dicom_text(in.file, 0x0008, 0x002a)));
    set_key(frame, DICOM_KEY_CLOCK, acquisition_of(in.file));
    if (dicom_text(in.file, 0x0020, 0x0013).empty())
        set_key(frame, DICOM_KEY_CLOCK, clock_of(in.file, 0x0023, 0x0033)); /* of the content */
    set_key(frame, DICOM_KEY_ACQUISITION, dicom_number(in.file, 0x0020, 0x0012));
    set_key(frame, DICOM_KEY_CONTENT, clock_of(in.file, 0x0023, 0x0033));
}

void fill_contrast(const groups &in, dicom_frame &frame) {
    const gdcm::DataSet diffusion = in.lookup(0x0018, 0x9117);
    set_key(frame, DICOM_KEY_ECHO, dicom_value<double>(in.lookup(0x0018, 0x9114), 0x0018, 0x9082));
    set_key(frame, DICOM_KEY_ECHO, dicom_number(in.file, 0x0018, 0x0081));
    set_key(frame, DICOM_KEY_DIFFUSION, dicom_value<double>(diffusion, 0x0018, 0x9087));
    set_key(frame, DICOM_KEY_DIFFUSION, dicom_b_value(in.file));
    if (std::isnan(frame.keys[DICOM_KEY_ECHO]))
        set_key(frame, DICOM_KEY_ECHO_NUMBER, dicom_number(in.file, 0x0018, 0x0086));
    set_key(frame, DICOM_KEY_VOLTAGE, dicom_number(in.file, 0x0018, 0x0060));
    set_key(frame, DICOM_KEY_VOLTAGE, dicom_number(in.lookup(0x0018, 0x9325), 0x0018, 0x0060));
    set_key(frame, DICOM_KEY_FLIP, dicom_number(in.file, 0x0018, 0x1314));
    set_key(frame, DICOM_KEY_INVERSION, dicom_number(in.file, 0x0018, 0x0082));
    set_key(frame, DICOM_KEY_THICKNESS, dicom_number(in.file, 0x0018, 0x0050));
    const gdcm::DataSet content = in.lookup(0x0020, 0x9111);
    dicom_copy(frame.stack, sizeof frame.stack, dicom_text(content, 0x0020, 0x9056));
}

void fill_dimensions(const groups &in, const std::vector<dicom_dimension> &dimensions,
                     dicom_frame &frame, dicom_tuple *other) {
    const std::vector<uint32_t> indices =
        dicom_values<uint32_t>(in.lookup(0x0020, 0x9111), 0x0020, 0x9157);
    dicom_tuple tuple;
    std::string name;
    for (const dicom_dimension &is : dimensions) {
        if (is.place >= indices.size())
            return;
        tuple.push_back(indices[is.place]);
        name += (name.empty() ? "" : ", ") + is.label + " " +
                dicom_dimension_value(in.lookup(is.group.GetGroup(), is.group.GetElement()), is,
                                      indices[is.place]);
    }
    if (dimensions.empty())
        return;
    *other = tuple;
    set_text(frame, DICOM_TEXT_OTHER, name);
}

void clear(dicom_frame &frame) {
    frame = dicom_frame();
    std::fill(std::begin(frame.keys), std::end(frame.keys), NAN);
}

/* Offsets of the frames of a dose: from the first frame, or positions along z. */
void place_dose(const numbers &offsets, uint32_t index, dicom_frame &frame) {
    if (index >= offsets.size()) {
        frame.is_assumed = frame.spacing[2] == 0;
        dicom_move(&frame, index * (frame.is_assumed ? 1 : frame.spacing[2]));
    } else if (offsets[0] != 0 && std::fabs(offsets[0] - frame.position[2]) < 1e-3)
        frame.position[2] = offsets[index];
    else {
        frame.is_contradicted = offsets[0] != 0;
        dicom_move(&frame, offsets[index]);
    }
}

} // namespace

dicom_gap dicom_gap_of(const gdcm::DataSet &set) {
    static const gdcm::Tag groups[] = { { 0x5200, 0x9229 },
                                        { 0x5200, 0x9230 },
                                        { 0x0054, 0x0022 } };
    for (const gdcm::Tag &tag : groups)
        if (set.FindDataElement(tag))
            return DICOM_NO_GAP;
    const bool has_position = dicom_numbers(set, 0x0020, 0x0032).size() >= 3;
    const bool has_location = std::isfinite(dicom_number(set, 0x0020, 0x1041));
    if (has_position && dicom_text(set, 0x0020, 0x0037).empty())
        return DICOM_NO_DIRECTIONS;
    return has_location && !has_position && !(dicom_number(set, 0x0028, 0x0008) > 1)
               ? DICOM_ONLY_LOCATION
               : DICOM_NO_GAP;
}

void dicom_move(dicom_frame *frame, double distance) {
    const double(*a)[3] = frame->along;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        frame->position[i] += distance * (a[0][j] * a[1][k] - a[0][k] * a[1][j]);
    }
}

/* The numbers that the bits of a pixel can have. */
static void fill_range(const dicom_image &image, dicom_frame &frame) {
    const double count = std::ldexp(1, static_cast<int>(std::min(image.bits, 64u)));
    frame.low = image.is_signed ? -count / 2 : 0;
    frame.high = image.is_signed ? count / 2 - 1 : count - 1;
}

namespace {

struct file_parts { /* what is read once for all frames */
    std::vector<dicom_dimension> dimensions;
    numbers offsets; /* GridFrameOffsetVector, of a dose */
    dicom_nuclear nuclear;
};

struct order { /* of the frames of a file, which keys number */
    std::vector<dicom_tuple> time, other;
};

} // namespace

static void fill_frame(const groups &in, const dicom_image &image, uint32_t index,
                       const file_parts &parts, dicom_frame &frame, order &order) {
    bool of_all;
    clear(frame);
    fill_spacing(in, frame);
    fill_values(in, frame);
    fill_range(image, frame);
    fill_segment(in, frame);
    fill_texts(in, frame);
    fill_time(in, frame);
    fill_contrast(in, frame);
    fill_dimensions(in, parts.dimensions, frame, &order.other[index]);
    frame.is_placed = fill_place(in, parts.nuclear.detector(index), frame, of_all);
    const double instance = dicom_number(in.file, 0x0020, 0x0013);
    const double in_stack = dicom_value<uint32_t>(in.lookup(0x0020, 0x9111), 0x0020, 0x9057);
    frame.instance = std::fabs(instance) < 1e12 ? static_cast<long>(instance) : 0;
    frame.slot = static_cast<double>(frame.instance);
    if (image.frames <= 1)
        return;
    const bool is_film = image.order == DICOM_ORDER_TIMES;
    frame.instance = frame.instance * DICOM_FRAMES_MAX + static_cast<long>(index) + 1;
    frame.slot = in_stack > 0 ? in_stack : is_film ? 0 : index + 1.0;
    if (image.is_mosaic) {
        dicom_place_tile(in.file, image, index, frame);
        return;
    }
    if (parts.nuclear.fill(index, &frame, &order.time[index], &order.other[index]) ||
        (frame.is_placed && !of_all))
        return;
    if (is_film)
        set_key(frame, DICOM_KEY_PHASE, index + 1.0);
    else if (in.file.FindDataElement(gdcm::Tag(0x3004, 0x000c)))
        place_dose(parts.offsets, index, frame);
    else {
        frame.is_assumed = frame.spacing[2] == 0;
        dicom_move(&frame, index * (frame.is_assumed ? 1 : frame.spacing[2]));
    }
}

/* FrameTimeVector: the milliseconds from each frame of a film to the next one, which FrameTime
 * replaces. Empty if there is none. */
static numbers film_intervals(const gdcm::DataSet &set, const dicom_image &image) {
    const bool is_vector = image.order == DICOM_ORDER_TIMES && image.frames > 1 &&
                           !(dicom_number(set, 0x0018, 0x1063) > 0);
    return is_vector ? dicom_numbers(set, 0x0018, 0x1065) : numbers();
}

void dicom_fill_frames(const gdcm::DataSet &set, const dicom_image &image, dicom_frame *frames,
                       uint32_t count) {
    const auto own = dicom_sequence(set, 0x5200, 0x9230);
    const file_parts parts = { dicom_dimensions(set), dicom_numbers(set, 0x3004, 0x000c),
                               dicom_nuclear(set) };
    order order = { std::vector<dicom_tuple>(count), std::vector<dicom_tuple>(count) };
    const numbers intervals = film_intervals(set, image);
    double time = 0;
    groups in = { set, gdcm::DataSet(), dicom_item(set, 0x5200, 0x9229) };
    for (uint32_t i = 0; i < count; i++) {
        in.own = own && i < own->GetNumberOfItems() ? own->GetItem(i + 1).GetNestedDataSet()
                                                    : gdcm::DataSet();
        fill_frame(in, image, i, parts, frames[i], order);
        if (i >= intervals.size())
            continue;
        time += i > 0 ? intervals[i] / 1000 : 0; /* that of the first frame has no meaning */
        frames[i].keys[DICOM_KEY_DELAY] = time;
    }
    dicom_number_tuples(order.time, DICOM_KEY_PHASE, frames);
    dicom_number_tuples(order.other, DICOM_KEY_OTHER, frames);
}
