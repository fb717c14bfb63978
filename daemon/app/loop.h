/* SPDX-License-Identifier: Apache-2.0 */
/* The one event loop, on libuv: descriptors of devices, signals, a periodic tick. */
#ifndef LP_APP_LOOP_H
#define LP_APP_LOOP_H

struct lp_loop;

int lp_loop_create(struct lp_loop **loop);

/* Call ready(context) whenever `fd` is readable. 0 or -errno. */
int lp_loop_watch(struct lp_loop *loop, int fd, void (*ready)(void *context), void *context);

/* Call caught(context, signal) on the loop thread. 0 or -errno. */
int lp_loop_on_signal(struct lp_loop *loop, int signal_number,
		      void (*caught)(void *context, int signal_number), void *context);

/* Call tick(context) every `period_ms`. 0 or -errno. */
int lp_loop_every(struct lp_loop *loop, unsigned int period_ms, void (*tick)(void *context),
		  void *context);

/* Returns after lp_loop_stop(). */
void lp_loop_run(struct lp_loop *loop);
void lp_loop_stop(struct lp_loop *loop);

/* Accepts NULL. Watched descriptors must still be open. */
void lp_loop_destroy(struct lp_loop *loop);

#endif
