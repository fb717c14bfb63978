/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The PCA9685 of a servo hat: one servo's pulse, by a chip on an I2C bus. A transfer takes half a
 * millisecond at 100 kHz, and may block for as long as the bus likes: a thread does them
 * (link/bus_thread.h). All calls and callbacks on the loop thread.
 */
#ifndef LP_WHEEL_PCA9685_HAT_H
#define LP_WHEEL_PCA9685_HAT_H

struct lp_loop;
struct lp_servo_hat;

struct lp_servo_hat_settings {
	char device[256]; /* of the bus */
	int address, channel;
};

struct lp_servo_hat_host {
	void *context;
	struct lp_loop *loop; /* outlives the hat */
	/* The chip is set up, and gives no pulse yet. */
	void (*ready)(void *context);
	/* It does not work any more; close() it. `stage`: static text. `error`: -errno. */
	void (*failed)(void *context, const char *stage, int error);
};

/* NULL: out of memory. Nothing is opened. */
struct lp_servo_hat *lp_servo_hat_create(const struct lp_servo_hat_settings *settings,
					 const struct lp_servo_hat_host *host);

/* Begin to set the chip up; ready() or failed() follows. -EBUSY: a transfer from before close() has
 * not ended yet. */
int lp_servo_hat_open(struct lp_servo_hat *hat);

/* Renew the pulse, every 20 ms while it is open; 0: no pulse. May call failed(): when the bus
 * hangs. */
void lp_servo_hat_pulse(struct lp_servo_hat *hat, float pulse_us);

/* Let the servo go. Returns at once. Does nothing when it is not open. */
void lp_servo_hat_close(struct lp_servo_hat *hat);

/* Accepts NULL. Closes it, and waits a moment for the servo to be let go. */
void lp_servo_hat_destroy(struct lp_servo_hat *hat);

#endif
