/* SPDX-License-Identifier: Apache-2.0 */
/* The header before each picture on the simulator link (proto/sim.md). */
#ifndef LP_SOURCE_SIM_HEADER_H
#define LP_SOURCE_SIM_HEADER_H

#include <stdbool.h>
#include <stdint.h>

#include "include/frame.h"

#define LP_SIM_HEADER_BYTES 64
#define LP_SIM_HEADER_KNOWN_BYTES 116 /* with what was added; a header may end before */
#define LP_SIM_HEADER_MAX_BYTES 4096
#define LP_SIM_PAYLOAD_MAX_BYTES ((uint64_t)128 << 20)

struct lp_sim_header {
	uint32_t header_bytes; /* what is beyond LP_SIM_HEADER_KNOWN_BYTES is to be skipped */
	uint64_t payload_bytes;
	enum lp_pixel_format format;
	uint32_t width_px, height_px,
		stride_bytes; /* stride as frame.h has it, never 0 but for MJPEG */
	uint64_t sequence;
	int64_t t_start_ns;
	float exposure_us, gain; /* NAN: not said */
	uint32_t flags; /* enum lp_frame_flag; CORRUPT also when the payload's size is wrong, or the
			 * exposure is longer than an hour */

	/* Filled by lp_sim_header_parse_more; NAN: not said. */
	float orientation[4], orientation_sigma_deg; /* as frame.h has them */
	float row_time_us;
	float exposure_min_us, exposure_max_us, exposure_step_us; /* as source.h has them */
	bool exposure_fixed;					  /* it cannot be commanded */
	float position_m[3], position_sigma_m; /* as frame.h has them; sigma 0: not said */
};

/* In the place of a header: another daemon is served, and the link ends here. */
bool lp_sim_header_is_busy(const uint8_t data[LP_SIM_HEADER_BYTES]);

/* NULL, or what is wrong with it: then nothing more of the stream can be understood. */
const char *lp_sim_header_parse(const uint8_t data[LP_SIM_HEADER_BYTES],
				struct lp_sim_header *header);

/* What of a header is beyond LP_SIM_HEADER_BYTES; `data` begins with the header and holds what
 * there is of the LP_SIM_HEADER_KNOWN_BYTES. Numbers that make no sense are taken as not said. */
void lp_sim_header_parse_more(const uint8_t data[LP_SIM_HEADER_KNOWN_BYTES],
			      struct lp_sim_header *header);

#endif
