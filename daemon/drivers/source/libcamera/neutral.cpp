/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/source/libcamera/neutral.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace lp
{
namespace
{

/* NAN as the neutral value: the camera's usual one (gamma: the drivers' only choice that is near
 * sRGB). By name: libcamera 0.0.3 does not know all of them yet. */
constexpr struct Row {
	const char *name;
	lp_processing kind;
	float neutral;
} ROWS[] = {
	{"HdrMode", LP_PROCESSING_DYNAMIC_RANGE, 0},
	{"WdrMode", LP_PROCESSING_DYNAMIC_RANGE, 0},
	{"NoiseReductionMode", LP_PROCESSING_NOISE_REDUCTION, 0},
	{"Brightness", LP_PROCESSING_BRIGHTNESS, 0},
	{"Contrast", LP_PROCESSING_CONTRAST, 1},
	{"Saturation", LP_PROCESSING_SATURATION, 1},
	{"Hue", LP_PROCESSING_HUE, 0},
	{"Gamma", LP_PROCESSING_GAMMA, NAN},
	{"Sharpness", LP_PROCESSING_SHARPNESS, 0},
};

const Row *row_of(const std::string &name)
{
	const auto *const found =
		std::find_if(std::begin(ROWS), std::end(ROWS),
			     [&name](const Row &row) { return name == row.name; });

	return found == std::end(ROWS) ? nullptr : found;
}

/* None: the control is of a type that no row has. */
libcamera::ControlValue value_of(const libcamera::ControlId &id, const Row &row,
				 const libcamera::ControlInfo &info)
{
	if (std::isnan(row.neutral))
		return info.def();
	switch (id.type()) {
	case libcamera::ControlTypeFloat:
		return libcamera::ControlValue(row.neutral);
	case libcamera::ControlTypeInteger32:
		return libcamera::ControlValue(static_cast<int32_t>(row.neutral));
	default:
		return {};
	}
}

template <typename T>
bool is_between(const libcamera::ControlValue &value, const libcamera::ControlInfo &info)
{
	return value.get<T>() >= info.min().get<T>() && value.get<T>() <= info.max().get<T>();
}

bool offers(const libcamera::ControlInfo &info, const libcamera::ControlValue &value)
{
	const auto &listed = info.values();

	if (value.isNone() || info.min().type() != value.type() ||
	    info.max().type() != value.type())
		return false;
	if (!listed.empty())
		return std::find(listed.begin(), listed.end(), value) != listed.end();
	return value.type() == libcamera::ControlTypeFloat ? is_between<float>(value, info)
							   : is_between<int32_t>(value, info);
}

} // namespace

void neutralize(const libcamera::ControlInfoMap &has, libcamera::ControlList &wanted,
		lp_processing_report &report)
{
	for (const auto &[id, info] : has) {
		const Row *const row = row_of(id->name());

		if (!row)
			continue;
		const libcamera::ControlValue value = value_of(*id, *row, info);

		if (!offers(info, value)) {
			lp_processing_on(&report, row->kind, "%s (%s)", row->name,
					 info.toString().c_str());
			continue;
		}
		wanted.set(id->id(), value);
		lp_processing_off(&report, "%s %s", row->name, value.toString().c_str());
	}
}

bool give_up_neutral(libcamera::ControlList &wanted, lp_processing_report &report)
{
	const libcamera::ControlIdMap *const names = wanted.idMap();
	libcamera::ControlList rest(*wanted.infoMap());
	bool has_any = false;

	for (const auto &[id, value] : wanted) {
		const Row *const row = row_of(names->at(id)->name());

		if (row)
			lp_processing_on(&report, row->kind, "%s (refused)", row->name);
		else
			rest.set(id, value);
		has_any = has_any || row;
	}
	if (!has_any)
		return false;
	*report.off_text = '\0';
	wanted.clear();
	wanted.merge(rest);
	return true;
}

} // namespace lp
