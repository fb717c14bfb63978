/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a frame gives, and how much of it is wanted: all that clients are told of the light comes
 * from here, and who tells them (serve/) includes no other file of estimate/. Plain data.
 */
#ifndef LP_ESTIMATE_ESTIMATES_H
#define LP_ESTIMATE_ESTIMATES_H

#include <stdalign.h>
#include <stdbool.h>
#include <stdint.h>

#include "include/light_estimate.h"
#include "light/clipped/ring_fusion.h"
#include "light/send/cube.h"

/* What reflections are made of (estimate/surroundings.h); probe frame, at the estimate's capture
 * time. */
struct lp_surroundings {
	int size; /* texels along an edge; 0: none were wanted */
	/* Lights of the estimate whose light is in it: area lights, and lamps that the newest
	 * panorama does not show as such. All others are not in it. */
	int kept_count;
	uint32_t kept[LP_MAX_LIGHTS];
	alignas(16) float rgb[3][LP_CUBE_MOST_TEXELS]; /* LP_CUBE_TEXELS(size) of each */
};

/* What the ring said of the newest frame, for health messages. */
struct lp_ring_status {
	enum lp_ring_verdict verdict;
	uint32_t wrong;
	float turned_deg;
	float mean_lux; /* that the ring reads */
	struct lp_ring_scale scale;
	bool camera_is_blind;
	bool fused;
	bool scale_is_wrong;
};

/* The most that any subscriber asks for; more is not computed. */
struct lp_demand {
	int sh_order;
	int max_lights;
	int reflection_size;   /* texels along an edge of lp_surroundings; 0: none are wanted */
	bool polarization_map; /* somebody waits for one */
};

struct lp_estimates {
	struct lp_light_estimate raw;	   /* what is known with this frame */
	struct lp_light_estimate smoothed; /* tracked in time; same ids */
	struct lp_ring_status ring;
	int places_left_out; /* of the pictures: they shine by themselves */
	/* The caller's, of a frame: filled if they are wanted, else of size 0. NULL: never. */
	struct lp_surroundings *surroundings;
};

#endif
