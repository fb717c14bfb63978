/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The microcontroller's clock on ours: offset and skew by regression over the newest exchanges, and
 * how far that can be off. Pure.
 *
 * One exchange bounds the truth for certain: the microcontroller stamped the request after it was
 * sent and `turnaround` before its reply came. The middle of that interval is used, weighted by how
 * narrow it is; delays that differ between the two ways cannot move it out of the interval.
 */
#ifndef LP_LINK_CLOCK_H
#define LP_LINK_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#define LP_CLOCK_EXCHANGES 32

struct lp_link_clock {
	int count, at;
	struct {
		int64_t device_us; /* unwrapped */
		int64_t host_ns;   /* middle */
		int64_t half_ns;   /* half the interval */
	} exchanges[LP_CLOCK_EXCHANGES];
	/* Host time = origin + 1000 * (1 + skew) * (device time - device origin). */
	int64_t device_origin_us, host_origin_ns;
	double skew;
	double origin_sigma_ns, skew_sigma;
	int64_t half_ns; /* the narrowest */
};

/* Zeroed at the start, and whenever the microcontroller was reset. False: an exchange that cannot
 * be, or is too slow to be of use; it is left out. One that contradicts those before begins anew:
 * this machine slept, or the microcontroller was reset unseen. */
bool lp_link_clock_add(struct lp_link_clock *clock, int64_t sent_ns, int64_t received_ns,
		       uint32_t device_us, uint32_t turnaround_us);

/* False: not known yet. `device_us` within half an hour of the newest exchange. */
bool lp_link_clock_at(const struct lp_link_clock *clock, uint32_t device_us, int64_t *host_ns,
		      int64_t *sigma_ns);

#endif
