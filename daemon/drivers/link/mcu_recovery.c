/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What the daemon does about the microcontroller's latched faults. Those that pass by themselves
 * are told and cleared; those that somebody must see stay latched until a person clears them.
 *
 * A fault of the wheel is cleared too, so that it can be homed again, but at most three times:
 * there may be a finger in the gear. Until a homing has succeeded the wheel's trouble keeps its
 * first name, and its text says what the tries end with: a wheel that is stuck with a tooth in a
 * sensor ends with INDEX_ALWAYS, and that alone would send somebody to mend the sensor.
 */
#include <stdio.h>

#include "base/log.h"
#include "drivers/link/mcu_faults.h"
#include "drivers/link/mcu_parts.h"

#define MOST_TRIES 3
#define STOPPED "; three attempts failed: repair, then restart lightprobed or replug"

static unsigned lowest_bit(uint32_t bits)
{
	unsigned number = 0;

	while (!(bits >> number & 1))
		number++;
	return number;
}

static void tell(struct lp_mcu *mcu, unsigned number, int detail)
{
	const struct lp_mcu_fault *fault = lp_mcu_fault(number);
	char text[400];

	(void)snprintf(text, sizeof(text), "%s: %s (%d): %s", mcu->object, fault->name, detail,
		       fault->words);
	lp_warning(mcu->object, fault->name, "%s (%d)", fault->words, detail);
	lp_mcu_report_fault(mcu, fault->name, text);
}

/* What the tries ended with. Clients get 160 bytes, so names must do; the log has the words. */
static void tell_tried(struct lp_mcu *mcu, unsigned number, int detail)
{
	const struct lp_mcu_recovery *self = &mcu->recovery;
	const struct lp_mcu_fault *first = lp_mcu_fault(self->trouble);
	const struct lp_mcu_fault *fault = lp_mcu_fault(number);
	char text[400];

	(void)snprintf(text, sizeof(text), "%s: %s, homed again: %s%s", mcu->object, first->name,
		       fault->name, self->stopped ? STOPPED : "");
	lp_warning(mcu->object, first->name, "homed again: %s (%d): %s%s", fault->name, detail,
		   fault->words, self->stopped ? STOPPED : "");
	lp_mcu_report_fault(mcu, first->name, text);
}

static void tell_over(struct lp_mcu *mcu, unsigned number)
{
	lp_mcu_report_fault(mcu, lp_mcu_fault(number)->name, NULL);
}

/* A wheel's fault has come: the first one begins the trouble, later ones are its tries' ends. */
static void wheel_failed(struct lp_mcu *mcu, unsigned number, int detail)
{
	struct lp_mcu_recovery *self = &mcu->recovery;

	if (self->trouble == 0) {
		self->trouble = number;
		tell(mcu, number, detail);
		return;
	}
	self->stopped = self->tries >= MOST_TRIES;
	tell_tried(mcu, number, detail);
}

static void trouble_is_over(struct lp_mcu *mcu)
{
	struct lp_mcu_recovery *self = &mcu->recovery;

	if (self->trouble)
		tell_over(mcu, self->trouble);
	self->trouble = 0;
	self->tries = 0;
	self->stopped = false;
	lp_backoff_reset(&self->clear);
}

void lp_mcu_set_faults(struct lp_mcu *mcu, uint32_t faults, int detail)
{
	struct lp_mcu_recovery *self = &mcu->recovery;
	const uint32_t come = faults & ~self->faults;
	const uint32_t gone = self->faults & ~faults;

	self->faults = faults;
	if (gone & LP_MCU_WHEEL_FAULTS && !(faults & LP_MCU_WHEEL_FAULTS))
		self->tries++; /* cleared: the wheel will be homed */
	if (come & LP_MCU_WHEEL_FAULTS)
		wheel_failed(mcu, lowest_bit(come & LP_MCU_WHEEL_FAULTS), detail);
	for (unsigned i = MCU_FAULTS_WHEEL_END; i < 32; i++) {
		if (come >> i & 1)
			tell(mcu, i, detail);
		if (gone >> i & 1)
			tell_over(mcu, i);
	}
	if (faults && self->t_clear_ns == 0)
		self->t_clear_ns = lp_clock_ns() + lp_backoff_next_ns(&self->clear);
}

/* What may be cleared now: nothing that was not told. */
static uint32_t to_clear(const struct lp_mcu_recovery *self)
{
	uint32_t faults = self->faults & lp_mcu_passing_faults();

	return self->stopped ? faults & ~LP_MCU_WHEEL_FAULTS : faults;
}

void lp_mcu_clear_faults(struct lp_mcu *mcu, int64_t now_ns)
{
	struct lp_mcu_recovery *self = &mcu->recovery;
	const struct mcu_fault_clear_t clear = {to_clear(self)};

	if (self->t_clear_ns == 0 || now_ns < self->t_clear_ns)
		return;
	self->t_clear_ns = 0;
	if (clear.faults == 0) {
		if (!self->trouble)
			lp_backoff_reset(&self->clear);
		return;
	}
	LP_MCU_SEND(mcu, fault_clear, FAULT_CLEAR, &clear);
	lp_mcu_ask_status(mcu);
	self->t_clear_ns =
		now_ns + lp_backoff_next_ns(&self->clear); /* should this have been lost */
}

void lp_mcu_wheel_settled(struct lp_mcu *mcu)
{
	if (mcu->recovery.trouble && !(mcu->recovery.faults & LP_MCU_WHEEL_FAULTS)) {
		lp_info(mcu->object, "wheel", "%s is over: the wheel has been homed",
			lp_mcu_fault(mcu->recovery.trouble)->name);
		trouble_is_over(mcu);
	}
}

void lp_mcu_forget_wheel_faults(struct lp_mcu *mcu)
{
	struct lp_mcu_recovery *self = &mcu->recovery;

	self->faults &= ~LP_MCU_WHEEL_FAULTS; /* the others stay told until it says that they end */
	self->t_clear_ns = 0;
}

void lp_mcu_was_reset(struct lp_mcu *mcu, uint8_t cause)
{
	/* By a person, as far as anyone can tell; a stalled servo's brown-out is no reason to turn
	 * it once more. */
	if (cause == MCU_HELLO_RESET_CAUSE_POWER_ON_CHOICE ||
	    cause == MCU_HELLO_RESET_CAUSE_EXTERNAL_CHOICE ||
	    cause == MCU_HELLO_RESET_CAUSE_REQUESTED_CHOICE)
		trouble_is_over(mcu);
}

bool lp_mcu_wheel_stopped(const struct lp_mcu *mcu)
{
	return mcu->recovery.stopped;
}
