/* SPDX-License-Identifier: Apache-2.0 */
#include "messages.h"

#include <string.h>

#include "dbc/mcu.h"
#include "firmware.h"

/* --- the schema's names and ours are the same --------------------------------------------------
 */

/* cantools spells "I2C" so. */
#define MCU_FAULT_FAULT_I2C_BUS_CHOICE MCU_FAULT_FAULT_I2_C_BUS_CHOICE
#define ASSERT_FAULT(name, number) \
	_Static_assert(FAULT_##name == MCU_FAULT_FAULT_##name##_CHOICE, "fault " #name);
MCU_FAULTS(ASSERT_FAULT)
#define ASSERT_PARAM(name, ...)                                                            \
	_Static_assert((int)PARAM_##name == MCU_PARAM_VALUE_PARAM_##name##_CHOICE, "param" \
										   " " #name);
PARAMS(ASSERT_PARAM)
#define ASSERT_SAME(ours, theirs) _Static_assert((int)(ours) == (int)(theirs), #ours)
ASSERT_SAME(WHEEL_UNKNOWN, MCU_WHEEL_STATE_PHASE_UNKNOWN_CHOICE);
ASSERT_SAME(WHEEL_HOMING, MCU_WHEEL_STATE_PHASE_HOMING_CHOICE);
ASSERT_SAME(WHEEL_MOVING, MCU_WHEEL_STATE_PHASE_MOVING_CHOICE);
ASSERT_SAME(WHEEL_SETTLED, MCU_WHEEL_STATE_PHASE_SETTLED_CHOICE);
ASSERT_SAME(WHEEL_FAULT, MCU_WHEEL_STATE_PHASE_FAULT_CHOICE);
ASSERT_SAME(ANSWER_OK, MCU_RESULT_RESULT_OK_CHOICE);
ASSERT_SAME(ANSWER_OUT_OF_RANGE, MCU_RESULT_RESULT_OUT_OF_RANGE_CHOICE);
ASSERT_SAME(ANSWER_NOT_HOMED, MCU_RESULT_RESULT_NOT_HOMED_CHOICE);
ASSERT_SAME(ANSWER_IN_FAULT, MCU_RESULT_RESULT_IN_FAULT_CHOICE);
ASSERT_SAME(ANSWER_BUSY, MCU_RESULT_RESULT_BUSY_CHOICE);
ASSERT_SAME(RESET_CAUSE_UNKNOWN, MCU_HELLO_RESET_CAUSE_UNKNOWN_CHOICE);
ASSERT_SAME(RESET_CAUSE_POWER_ON, MCU_HELLO_RESET_CAUSE_POWER_ON_CHOICE);
ASSERT_SAME(RESET_CAUSE_EXTERNAL, MCU_HELLO_RESET_CAUSE_EXTERNAL_CHOICE);
ASSERT_SAME(RESET_CAUSE_BROWN_OUT, MCU_HELLO_RESET_CAUSE_BROWN_OUT_CHOICE);
ASSERT_SAME(RESET_CAUSE_WATCHDOG, MCU_HELLO_RESET_CAUSE_WATCHDOG_CHOICE);
ASSERT_SAME(RESET_CAUSE_STACK, MCU_HELLO_RESET_CAUSE_STACK_CHOICE);
ASSERT_SAME(RESET_CAUSE_REQUESTED, MCU_HELLO_RESET_CAUSE_REQUESTED_CHOICE);
ASSERT_SAME(BOARD_HOST, MCU_HELLO_BOARD_HOST_CHOICE);
ASSERT_SAME(BOARD_ATMEGA328P, MCU_HELLO_BOARD_ATMEGA328_P_CHOICE);
ASSERT_SAME(CARRIER_SERIAL, MCU_CAPABILITIES_CARRIER_SERIAL_CHOICE);
ASSERT_SAME(CARRIER_I2C, MCU_CAPABILITIES_CARRIER_I2_C_CHOICE);
ASSERT_SAME(CARRIER_CAN, MCU_CAPABILITIES_CARRIER_CAN_CHOICE);

/* --- sending -----------------------------------------------------------------------------------
 */

#define ID(frame) ((uint8_t)((frame)-LINK_CAN_BASE))
#define RESET_KEY 0xB007
#define HELLO_MS 1000
#define RESERVE 6 /* places in the queue that rings leave to everything else */

/* Owed to the host. */
enum {
	OWE_HELLO = 1 << 0,
	OWE_CAPABILITIES = 1 << 1,
	OWE_FAULTS = 1 << 2,
	OWE_WHEEL = 1 << 3,
	OWE_COUNTERS = 1 << 4,
	OWE_SERVO = 1 << 5,
};

/* Packs and queues one message of the schema: SEND(firmware, wheel_state, WHEEL_STATE, &struct). */
#define SEND(firmware, name, NAME, signals)                                                   \
	do {                                                                                  \
		struct message *out = link_send(&(firmware)->link, ID(MCU_##NAME##_FRAME_ID), \
						MCU_##NAME##_LENGTH);                         \
		if (out)                                                                      \
			mcu_##name##_pack(out->payload, signals, MESSAGE_MAX_BYTES);          \
	} while (0)

static void send_result(struct firmware *firmware, uint8_t request, uint8_t answer, uint8_t token)
{
	struct mcu_result_t result = {.request = request, .result = answer, .token = token};

	SEND(firmware, result, RESULT, &result);
}

/* What came of a save. A cell that fails has spoilt the copy that it lies in. */
static void send_saved(struct firmware *firmware)
{
	uint16_t address = firmware->params.worn_address;
	struct mcu_result_t result = {.request = ID(MCU_PARAM_ACTION_FRAME_ID)};

	if (address != PARAMS_SAVED) {
		result.result = MCU_RESULT_RESULT_NOT_STORED_CHOICE;
		result.detail = (int16_t)address;
		safe_latch(&firmware->safe, FAULT_PARAMS_COPY_LOST, firmware->params.generation);
	}
	SEND(firmware, result, RESULT, &result);
}

static void send_hello(struct firmware *firmware)
{
	struct mcu_hello_t hello = {
		.protocol_major = PROTOCOL_MAJOR,
		.protocol_minor = PROTOCOL_MINOR,
		.firmware_major = FIRMWARE_MAJOR,
		.firmware_minor = FIRMWARE_MINOR,
		.firmware_patch = FIRMWARE_PATCH,
		.reset_cause = firmware->info.reset_cause,
		.board = firmware->info.kind,
		.boot_count = firmware->info.boot_count,
	};

	SEND(firmware, hello, HELLO, &hello);
}

static void send_capabilities(struct firmware *firmware)
{
	const struct params *params = &firmware->params;
	struct mcu_capabilities_t capabilities = {
		.ring_sensors = BOARD_LDRS,
		.carrier = firmware->link.carrier,
		.feedback = param(params, PARAM_FEEDBACK_DDEG_FS) != 0,
		.window_scans = firmware->ring.window_scans,
		.scan_us = ring_scan_us(&firmware->ring),
		.wheel_min_cdeg = param(params, PARAM_WHEEL_MIN_CDEG),
		.wheel_max_cdeg = param(params, PARAM_WHEEL_MAX_CDEG),
	};

	SEND(firmware, capabilities, CAPABILITIES, &capabilities);
}

static void send_faults(struct firmware *firmware)
{
	struct mcu_fault_state_t faults = {
		.latched = safe_latched(&firmware->safe),
		.sensors_open = firmware->ring.open,
		.sensors_shorted = firmware->ring.shorted,
	};

	SEND(firmware, fault_state, FAULT_STATE, &faults);
}

static void send_wheel(struct firmware *firmware)
{
	const struct wheel *wheel = &firmware->wheel;
	struct wheel_report report;

	wheel_report(wheel, &report);
	firmware->wheel_counter = (firmware->wheel_counter + 1) & 0x0F;
	struct mcu_wheel_state_t state = {
		.counter = firmware->wheel_counter,
		.phase = wheel->phase,
		.servo_on = wheel->servo_on,
		.token = wheel->token,
		.commanded_cdeg = report.commanded_cdeg,
		.measured_cdeg = report.measured_cdeg,
		.sigma_cdeg = report.sigma_cdeg,
	};
	struct mcu_wheel_time_t time = {
		.counter = firmware->wheel_counter,
		.phase = wheel->phase,
		.token = wheel->token,
		.t_phase_us = wheel->t_phase_us,
		.age_ms = wheel->age_ms,
	};

	SEND(firmware, wheel_state, WHEEL_STATE, &state);
	SEND(firmware, wheel_time, WHEEL_TIME, &time);
}

static void send_counters(struct firmware *firmware)
{
	const struct link *link = &firmware->link;
	struct mcu_counters_link_t of_link = {
		.rx_good = link->rx_good,
		.rx_bad = link->rx_bad,
		.tx_dropped = link->tx_dropped,
		.rx_overrun = board_uart_overruns(),
		.rx_unknown = firmware->rx_unknown,
	};
	struct mcu_counters_work_t of_work = {
		.uptime_s = firmware->now_ms / 1000,
		.ring_dropped = firmware->rings_dropped + firmware->ring.windows_missed,
		.index_errors = firmware->wheel.errors,
		.params_generation = firmware->params.generation,
		.stack_free_bytes = board_stack_free_bytes(),
	};

	SEND(firmware, counters_link, COUNTERS_LINK, &of_link);
	SEND(firmware, counters_work, COUNTERS_WORK, &of_work);
}

static void send_param(struct firmware *firmware, uint8_t which)
{
	struct mcu_param_value_t value = {
		.param = which,
		.count = PARAM_COUNT,
		.value = param(&firmware->params, which),
	};

	param_limits(which, &value.minimum, &value.maximum);
	SEND(firmware, param_value, PARAM_VALUE, &value);
}

static void send_servo(struct firmware *firmware)
{
	struct mcu_wheel_servo_t message = {
		.pulse_hus = wheel_pulse_half_us(&firmware->wheel),
		.edges = firmware->wheel.below,
	};

	SEND(firmware, wheel_servo, WHEEL_SERVO, &message);
}

static void send_fault(struct firmware *firmware, enum fault fault)
{
	const struct safe_fault *state = &firmware->safe.faults[fault];
	struct mcu_fault_t message = {
		.fault = fault,
		.active = state->latched,
		.detail = state->detail,
		.t_us = state->t_us,
		.counter = ++firmware->fault_counter,
	};

	SEND(firmware, fault, FAULT, &message);
}

void messages_ring(struct firmware *firmware, const struct ring_report *report)
{
	const uint16_t *levels = report->levels;
	const struct ring *ring = &firmware->ring;
	uint8_t counter = ++firmware->ring_counter;

	if (link_room(&firmware->link) < 3 + RESERVE) {
		firmware->rings_dropped++;
		return;
	}
	struct mcu_ring0_t part0 = {counter, report->t_us, levels[0], levels[1]};
	struct mcu_ring1_t part1 = {counter, levels[2], levels[3], levels[4], levels[5]};
	struct mcu_ring2_t part2 = {
		counter,	levels[6], levels[7], levels[8], ring->open | ring->shorted,
		ring->supply_cv};

	SEND(firmware, ring0, RING0, &part0);
	SEND(firmware, ring1, RING1, &part1);
	SEND(firmware, ring2, RING2, &part2);
}

/* --- handling ----------------------------------------------------------------------------------
 */

struct context {
	struct firmware *firmware;
	const struct link_message *received;
	const uint8_t *payload;
	uint8_t id;
};

static void on_hello(const struct context *c)
{
	struct mcu_hello_request_t request;

	mcu_hello_request_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	c->firmware->owed |= OWE_HELLO | OWE_CAPABILITIES;
	if (request.protocol_major != PROTOCOL_MAJOR)
		send_result(c->firmware, c->id, MCU_RESULT_RESULT_BAD_VERSION_CHOICE, 0);
}

static void on_wheel_move(const struct context *c)
{
	struct mcu_wheel_move_t move;

	mcu_wheel_move_unpack(&move, c->payload, MESSAGE_MAX_BYTES);
	uint8_t answer = wheel_move(&c->firmware->wheel, move.token, move.target_cdeg,
				    move.slew_ddeg_s, move.hold_ds);
	send_result(c->firmware, c->id, answer, move.token);
}

static void on_wheel_action(const struct context *c)
{
	struct mcu_wheel_action_t request;
	uint8_t answer = ANSWER_OK;

	mcu_wheel_action_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	if (request.action == MCU_WHEEL_ACTION_ACTION_HOME_CHOICE)
		answer = wheel_home(&c->firmware->wheel, request.token);
	else if (request.action == MCU_WHEEL_ACTION_ACTION_RELEASE_CHOICE)
		wheel_release(&c->firmware->wheel);
	else
		answer = ANSWER_OUT_OF_RANGE;
	c->firmware->owed |= OWE_WHEEL;
	send_result(c->firmware, c->id, answer, request.token);
}

static void on_wheel_pulse(const struct context *c)
{
	struct mcu_wheel_pulse_t request;

	mcu_wheel_pulse_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	send_result(c->firmware, c->id, wheel_pulse(&c->firmware->wheel, request.pulse_hus), 0);
	c->firmware->owed |= OWE_WHEEL;
}

static void on_wheel_request(const struct context *c)
{
	const struct wheel *wheel = &c->firmware->wheel;
	struct mcu_wheel_request_t request;
	struct wheel_report report;

	mcu_wheel_request_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	wheel_report(wheel, &report);
	struct mcu_wheel_reply_t reply = {
		.count = request.count,
		.phase = wheel->phase,
		.servo_on = wheel->servo_on,
		.token = wheel->token,
		.measured_cdeg = report.measured_cdeg,
		.sigma_cdeg = report.sigma_cdeg,
	};
	SEND(c->firmware, wheel_reply, WHEEL_REPLY, &reply);
}

static void on_fault_clear(const struct context *c)
{
	struct firmware *firmware = c->firmware;
	struct mcu_fault_clear_t request;

	mcu_fault_clear_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	safe_clear(&firmware->safe, request.faults);
	if (firmware->wheel.phase == WHEEL_FAULT && !safe_wheel_stopped(&firmware->safe))
		wheel_forget(&firmware->wheel);
	send_result(firmware, c->id, ANSWER_OK, 0);
}

static void on_rates(const struct context *c)
{
	struct firmware *firmware = c->firmware;
	struct mcu_rates_t rates;

	mcu_rates_unpack(&rates, c->payload, MESSAGE_MAX_BYTES);
	firmware->host_known = true;
	firmware->wheel_ms = firmware->wheel_due_ms = rates.wheel_ms;
	firmware->counters_ms = firmware->counters_due_ms = rates.counters_ms;
	ring_set_interval(&firmware->ring, rates.ring_scans);
	send_result(firmware, c->id, ANSWER_OK, 0);
}

static void on_time(const struct context *c)
{
	struct mcu_time_request_t request;

	mcu_time_request_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	uint32_t turnaround_us = board_time_us() - c->received->t_rx_us;
	struct mcu_time_reply_t reply = {
		.count = request.count,
		.t_rx_us = c->received->t_rx_us,
		.turnaround_us = turnaround_us > UINT16_MAX ? UINT16_MAX : turnaround_us,
		.stamped = c->received->stamped && turnaround_us <= UINT16_MAX,
	};
	SEND(c->firmware, time_reply, TIME_REPLY, &reply);
}

static void on_param_get(const struct context *c)
{
	struct mcu_param_get_t request;

	mcu_param_get_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	if (request.param < PARAM_COUNT)
		send_param(c->firmware, request.param);
	else
		send_result(c->firmware, c->id, ANSWER_OUT_OF_RANGE, 0);
}

/* What was computed from parameters is computed again. Carriers read theirs at a reset. */
static void params_changed(struct firmware *firmware, bool wheel, bool ring)
{
	if (wheel && firmware->wheel.phase != WHEEL_FAULT)
		wheel_forget(&firmware->wheel);
	if (ring)
		ring_init(&firmware->ring, &firmware->params, &firmware->safe);
}

static void on_param_set(const struct context *c)
{
	struct firmware *firmware = c->firmware;
	struct mcu_param_set_t request;

	mcu_param_set_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	if (params_saving(&firmware->params)) {
		send_result(firmware, c->id, ANSWER_BUSY, 0);
		return;
	}
	if (request.param >= PARAM_COUNT ||
	    !param_set(&firmware->params, request.param, request.value)) {
		send_result(firmware, c->id, ANSWER_OUT_OF_RANGE, 0);
		return;
	}
	params_changed(firmware, request.param < PARAM_MAINS_HZ,
		       request.param >= PARAM_MAINS_HZ && request.param <= PARAM_SUPPLY_MIN_MV);
	send_param(firmware, request.param);
}

static void on_param_action(const struct context *c)
{
	struct firmware *firmware = c->firmware;
	struct mcu_param_action_t request;

	mcu_param_action_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	if (params_saving(&firmware->params)) {
		send_result(firmware, c->id, ANSWER_BUSY, 0);
		return;
	}
	if (request.action == MCU_PARAM_ACTION_ACTION_SAVE_CHOICE) {
		params_save(&firmware->params);
		firmware->saving = true; /* answered when done */
		return;
	}
	if (request.action == MCU_PARAM_ACTION_ACTION_RELOAD_CHOICE) {
		if (params_load(&firmware->params) == PARAMS_CORRUPT)
			safe_latch(&firmware->safe, FAULT_PARAMS_LOST, 0);
	} else if (request.action == MCU_PARAM_ACTION_ACTION_DEFAULTS_CHOICE) {
		params_defaults(&firmware->params);
	} else {
		send_result(firmware, c->id, ANSWER_OUT_OF_RANGE, 0);
		return;
	}
	params_changed(firmware, true, true);
	send_result(firmware, c->id, ANSWER_OK, 0);
}

static void on_status(const struct context *c)
{
	send_result(c->firmware, c->id, ANSWER_OK, 0);
	c->firmware->owed |= OWE_CAPABILITIES | OWE_FAULTS | OWE_SERVO | OWE_WHEEL | OWE_COUNTERS;
}

static void on_reset(const struct context *c)
{
	struct mcu_reset_t request;

	mcu_reset_unpack(&request, c->payload, MESSAGE_MAX_BYTES);
	if (request.key != RESET_KEY) {
		send_result(c->firmware, c->id, ANSWER_OUT_OF_RANGE, 0);
		return;
	}
	wheel_forget(&c->firmware->wheel);
	board_reset(RESET_CAUSE_REQUESTED);
}

struct handler {
	uint8_t id, length_bytes;
	void (*handle)(const struct context *context);
};

#define HANDLER(NAME, function)                                          \
	{                                                                \
		ID(MCU_##NAME##_FRAME_ID), MCU_##NAME##_LENGTH, function \
	}
static const BOARD_FLASH struct handler handlers[] = {
	HANDLER(HELLO_REQUEST, on_hello),
	HANDLER(WHEEL_MOVE, on_wheel_move),
	HANDLER(WHEEL_ACTION, on_wheel_action),
	HANDLER(FAULT_CLEAR, on_fault_clear),
	HANDLER(RATES, on_rates),
	HANDLER(TIME_REQUEST, on_time),
	HANDLER(PARAM_GET, on_param_get),
	HANDLER(PARAM_SET, on_param_set),
	HANDLER(PARAM_ACTION, on_param_action),
	HANDLER(STATUS_REQUEST, on_status),
	HANDLER(RESET, on_reset),
	HANDLER(WHEEL_REQUEST, on_wheel_request),
	HANDLER(WHEEL_PULSE, on_wheel_pulse),
};

void messages_handle(struct firmware *firmware, const struct link_message *received)
{
	const struct message *message = &received->message;
	struct context context = {firmware, received, message->payload, message->id};

	for (uint8_t i = 0; i < sizeof(handlers) / sizeof(handlers[0]); i++) {
		if (handlers[i].id != message->id)
			continue;
		if (handlers[i].length_bytes != message->length_bytes) {
			firmware->link.rx_bad++;
			send_result(firmware, message->id, MCU_RESULT_RESULT_BAD_LENGTH_CHOICE, 0);
			return;
		}
		firmware->link.rx_good++;
		handlers[i].handle(&context);
		return;
	}
	firmware->rx_unknown++;
	send_result(firmware, message->id, MCU_RESULT_RESULT_UNKNOWN_ID_CHOICE, 0);
}

/* --- by time -----------------------------------------------------------------------------------
 */

static bool due(uint16_t *left_ms, uint16_t period_ms)
{
	if (period_ms == 0 || --*left_ms > 0)
		return false;
	*left_ms = period_ms;
	return true;
}

void messages_tick(struct firmware *firmware)
{
	if (firmware->host_known)
		firmware->hello_due_ms = 1;
	else if (due(&firmware->hello_due_ms, HELLO_MS))
		firmware->owed |= OWE_HELLO;
	if (due(&firmware->wheel_due_ms, firmware->wheel_ms))
		firmware->owed |= OWE_WHEEL;
	if (due(&firmware->counters_due_ms, firmware->counters_ms))
		firmware->owed |= OWE_COUNTERS;
}

/* Takes one debt off, if it is owed and there is room for its messages. */
static bool settle_debt(struct firmware *firmware, uint8_t debt, uint8_t messages)
{
	if (!(firmware->owed & debt) || link_room(&firmware->link) < messages)
		return false;
	firmware->owed &= ~debt;
	return true;
}

void messages_poll(struct firmware *firmware)
{
	enum fault fault;

	if (firmware->wheel.changed && firmware->host_known)
		firmware->owed |= OWE_WHEEL;
	firmware->wheel.changed = false;
	if (settle_debt(firmware, OWE_HELLO, 1))
		send_hello(firmware);
	if (settle_debt(firmware, OWE_CAPABILITIES, 1))
		send_capabilities(firmware);
	while (firmware->host_known && link_room(&firmware->link) &&
	       (fault = safe_next_report(&firmware->safe)) != FAULT_NONE)
		send_fault(firmware, fault);
	if (settle_debt(firmware, OWE_FAULTS, 1))
		send_faults(firmware);
	if (settle_debt(firmware, OWE_SERVO, 1))
		send_servo(firmware);
	if (settle_debt(firmware, OWE_WHEEL, 2))
		send_wheel(firmware);
	if (settle_debt(firmware, OWE_COUNTERS, 2))
		send_counters(firmware);
	if (firmware->saving && !params_saving(&firmware->params) && link_room(&firmware->link)) {
		firmware->saving = false;
		send_saved(firmware);
	}
}
