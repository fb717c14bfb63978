/* SPDX-License-Identifier: Apache-2.0 */
/* What the box has besides its camera: the polarizer wheel and the ring of light sensors, each
 * optional. Loop thread. */
#ifndef LP_APP_BOX_INSTRUMENTS_H
#define LP_APP_BOX_INSTRUMENTS_H

#include <stdint.h>

struct lp_frame;
struct lp_health;
struct lp_instruments;
struct lp_light_estimate;
struct lp_loop;
struct lp_options;
struct lp_ring_sample;

struct lp_instruments_host {
	void *context;
	struct lp_loop *loop; /* outlives the instruments */
	/* A frame that may be used, stamped with the wheel's angle where it is known. Takes over
	 * the reference. */
	void (*frame)(void *context, struct lp_frame *frame);
	void (*ring)(void *context, const struct lp_ring_sample *sample);
};

/* `health` is counted into; borrowed. -EINVAL, -EPROTONOSUPPORT, logged. */
int lp_instruments_create(const struct lp_options *options, struct lp_health *health,
			  const struct lp_instruments_host *host,
			  struct lp_instruments **instruments);
int lp_instruments_start(struct lp_instruments *instruments);

/* Takes over the reference to `frame`. */
void lp_instruments_frame(struct lp_instruments *instruments, struct lp_frame *frame);

/* Several times a second. */
void lp_instruments_tick(struct lp_instruments *instruments, int64_t now_ns);

/* What the newest frame showed: a new bright region of unknown polarization ends the wheel's rest.
 */
void lp_instruments_see(struct lp_instruments *instruments,
			const struct lp_light_estimate *estimate);

/* Go round the polarizer's angles now. 0: that is over when Health.wheel.sweeps has reached
 * *done_at. -ENODEV, -EOPNOTSUPP, -EIO: it cannot; *reason (static) says why, next step included.
 */
int lp_instruments_sweep(struct lp_instruments *instruments, uint64_t *done_at,
			 const char **reason);

/* enum lp_estimate_flag: what is wrong with wheel and ring now. */
uint32_t lp_instruments_flags(const struct lp_instruments *instruments);

/* Accepts NULL. Frames that wait go back to their source, which must still be there. */
void lp_instruments_destroy(struct lp_instruments *instruments);

#endif
