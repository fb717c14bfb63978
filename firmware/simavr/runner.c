/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Runs the flashed binary: see usage(). Commands come as lines on stdin or on the control socket;
 * each gets one answer line ("ok ...", a value, or "error: ..."), `frames` several.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "board/host/console.h"
#include "board/host/line.h"
#include "chip.h"
#include "mcp2515.h"

#define SLICE_US 500
#define SRAM_START 0x100

#define CAN_FRAMES 4096

struct can_log {
	struct can_record records[CAN_FRAMES];
	uint64_t t_us[CAN_FRAMES];
	unsigned first, end;
};

struct runner {
	struct chip *chip;
	struct can_log can_log;
	bool real_time;
	uint64_t due_cycle; /* where the chip should be by now */
	struct line line;
	int can_listener, can_client;
	struct console console;
	bool quit;
};

static void usage(void)
{
	puts("usage: lightprobe-mcu-simavr ELF [options]\n"
	     "Runs the firmware in simavr with a simulated box. Options:\n"
	     "  --real-time     paced by the wall clock; else time passes only in `run`\n"
	     "  --carrier C     strap: serial (default), i2c, can\n"
	     "  --pty PATH      symbolic link to make: the serial line\n"
	     "  --control PATH  Unix socket for commands; else stdin and stdout\n"
	     "  --can PATH      Unix socket of struct can_frame records: the CAN bus\n"
	     "  --eeprom FILE   keep the parameters there\n"
	     "  --seed N        of the simulated noise\n"
	     "Commands, one a line, each with one answer:\n"
	     "  run US          let time pass\n"
	     "  flush           send what the firmware has put on the serial line\n"
	     "  time            microseconds since the start\n"
	     "  load            since the last question: share of the time that the CPU was\n"
	     "                  awake, and the longest that it was without sleep, us\n"
	     "  set NAME VALUE, get NAME, names   numbers of the box: board/host/world.h\n"
	     "  angles FROM_NS TO_NS COUNT        where the wheel was, by CLOCK_MONOTONIC\n"
	     "  tx HEX          bytes to the MCU on the serial line\n"
	     "  frames          frames from it: count, then lines of time, least and\n"
	     "                  greatest wheel angle of the 2 ms before, bytes\n"
	     "  servo           pulses since the last question: count, least and greatest\n"
	     "                  width, last period, times of the first and the last, us\n"
	     "  twi write HEX, twi read N, twi error   I2C master\n"
	     "  can send ID HEX [ext|rtr], can busoff 0|1, can absent 0|1\n"
	     "  can frames      as frames: time, two zeros, identifier:bytes\n"
	     "  reset [power|brownout|external]\n"
	     "  resets          how many there were, the watchdog's too\n"
	     "  cut ADDRESS     run until this EEPROM byte is being written, then cut the power\n"
	     "  eeprom [HEX]    read all, or write from 0\n"
	     "  worn ADDRESS BITS   of this EEPROM byte these bits keep what they hold\n"
	     "  flash ADDRESS [HEX], ram ADDRESS [N | =HEX]   look, or change\n"
	     "  stack ADDRESS   bytes free, stack used, static: ADDRESS is the end of the data\n"
	     "  quit");
}

/* --- commands -----------------------------------------------------------------------------------
 */

static void take_from_outside(struct runner *runner);

static void run_for(struct runner *runner, uint64_t us)
{
	struct chip *chip = runner->chip;
	uint64_t end = runner->due_cycle + CHIP_US(us);

	/* A sleeping chip oversteps the end a little: the next run is that much shorter. */
	runner->due_cycle = end;
	while (chip->avr->cycle < end && !chip->dead) {
		uint64_t next = chip->avr->cycle + CHIP_US(SLICE_US);
		take_from_outside(runner);
		chip_run_until(chip, next < end ? next : end);
	}
}

static void command_servo(struct runner *runner)
{
	struct chip_servo *servo = &runner->chip->servo;

	console_answer(&runner->console, "%llu %.3f %.3f %.3f %llu %llu",
		       (unsigned long long)servo->pulses, servo->least_us, servo->most_us,
		       servo->period_us, (unsigned long long)servo->first_us,
		       (unsigned long long)servo->last_us);
	*servo = (struct chip_servo){0};
}

static void command_twi(struct runner *runner, const char *rest)
{
	uint8_t bytes[256];
	double stretch_us = 0;
	int count;

	if (strncmp(rest, "write", 5) == 0) {
		count = console_unhex(rest + 5, bytes, sizeof(bytes));
		if (count < 0) {
			console_answer(&runner->console, "error: not hexadecimal");
			return;
		}
		count = chip_twi_write(runner->chip, bytes, count, &stretch_us);
		console_answer(&runner->console, "%d %.1f", count, stretch_us);
	} else if (sscanf(rest, "read %d", &count) == 1 && count > 0 && count <= 256) {
		count = chip_twi_read(runner->chip, bytes, count, &stretch_us);
		console_answer(&runner->console, "%d %.1f ", count, stretch_us);
		console_answer_hex(&runner->console, bytes, count > 0 ? count : 0);
	} else if (strcmp(rest, "error") == 0) {
		chip_twi_error(runner->chip);
		console_answer(&runner->console, "ok");
	} else {
		console_answer(&runner->console, "error: twi write HEX | read N | error");
	}
}

static void answer_can_frames(struct runner *runner)
{
	struct can_log *log = &runner->can_log;

	console_answer(&runner->console, "%u", log->end - log->first);
	for (; log->first != log->end; log->first++) {
		const struct can_record *record = &log->records[log->first % CAN_FRAMES];
		console_answer(&runner->console, "\n%llu 0 0 %x:",
			       (unsigned long long)log->t_us[log->first % CAN_FRAMES],
			       record->identifier);
		console_answer_hex(&runner->console, record->data, record->length);
	}
}

static void command_can(struct runner *runner, const char *rest)
{
	struct can_record record = {0};
	char hex[40] = "", kind[8] = "";
	unsigned value;
	int fields = sscanf(rest, "send %x %39s %7s", &record.identifier, hex, kind);

	if (fields >= 1) {
		int count = strcmp(hex, "-") == 0 ? 0 : console_unhex(hex, record.data, 8);
		record.length = count < 0 ? 0 : count;
		record.identifier |= strcmp(kind, "ext") == 0 ? 1U << 31 : 0;
		record.identifier |= strcmp(kind, "rtr") == 0 ? 1U << 30 : 0;
		console_answer(&runner->console,
			       mcp2515_receive(runner->chip->can, &record) ? "ok" : "lost");
	} else if (strcmp(rest, "frames") == 0) {
		answer_can_frames(runner);
	} else if (sscanf(rest, "busoff %u", &value) == 1) {
		mcp2515_bus_off(runner->chip->can, value);
		console_answer(&runner->console, "ok");
	} else if (sscanf(rest, "absent %u", &value) == 1) {
		mcp2515_absent(runner->chip->can, value);
		console_answer(&runner->console, "ok");
	} else {
		console_answer(&runner->console,
			       "error: can send ID HEX [ext|rtr] | busoff 0|1 | absent 0|1");
	}
}

static void command_reset(struct runner *runner, const char *why)
{
	if (strcmp(why, "power") == 0)
		chip_reset(runner->chip, CHIP_POWER_ON);
	else if (strcmp(why, "brownout") == 0)
		chip_reset(runner->chip, CHIP_BROWN_OUT);
	else if (strcmp(why, "external") == 0)
		chip_reset(runner->chip, CHIP_EXTERNAL);
	else {
		console_answer(&runner->console, "error: reset power | brownout | external");
		return;
	}
	console_answer(&runner->console, "ok");
}

/* EEARL, EEARH, EECR in data space. */
static bool writing_eeprom(const avr_t *avr, unsigned address)
{
	return avr->data[0x3F] & 0x02 && (avr->data[0x41] | avr->data[0x42] << 8) == (int)address;
}

static void command_cut(struct runner *runner, unsigned address)
{
	struct chip *chip = runner->chip;
	uint64_t end = chip->avr->cycle + CHIP_US(2000000);

	while (chip->avr->cycle < end && !writing_eeprom(chip->avr, address))
		run_for(runner, 50);
	if (!writing_eeprom(chip->avr, address)) {
		console_answer(&runner->console, "error: byte %u was not written within 2 s",
			       address);
		return;
	}
	chip_eeprom(chip)[address] = rand(); /* half erased, half written */
	chip_reset(chip, CHIP_POWER_ON);
	console_answer(&runner->console, "ok");
}

static void command_memory(struct runner *runner, const char *kind, unsigned address,
			   const char *rest)
{
	avr_t *avr = runner->chip->avr;
	bool flash = strcmp(kind, "flash") == 0;
	uint8_t *memory = flash ? avr->flash : avr->data;
	unsigned size = flash ? avr->flashend : avr->ramend;
	uint8_t bytes[256];

	if (address + sizeof(bytes) > size + sizeof(bytes)) {
		console_answer(&runner->console, "error: no such address");
		return;
	}
	if (flash || *rest == '=') {
		console_answer_hex(&runner->console, memory + address, 2);
		int count = console_unhex(*rest == '=' ? rest + 1 : rest, bytes, sizeof(bytes));
		if (count > 0)
			memcpy(memory + address, bytes, count);
		return;
	}
	unsigned count = *rest ? strtoul(rest, NULL, 0) : 1;
	console_answer_hex(&runner->console, memory + address,
			   count > sizeof(bytes) ? sizeof(bytes) : count);
}

/* Bytes between `address` (end of the static data) and the deepest stack so far, painted by the
 * firmware. */
static void command_stack(struct runner *runner, unsigned address)
{
	const avr_t *avr = runner->chip->avr;
	unsigned at = address;

	while (at < avr->ramend && avr->data[at] == 0xC5)
		at++;
	console_answer(&runner->console, "%u %u %u", at - address, avr->ramend + 1 - at,
		       address - SRAM_START);
}

static void command_eeprom(struct runner *runner, const char *rest)
{
	uint8_t bytes[CHIP_EEPROM_BYTES];
	int count = console_unhex(rest, bytes, sizeof(bytes));

	if (count < 0) {
		console_answer(&runner->console, "error: not hexadecimal");
		return;
	}
	memcpy(chip_eeprom(runner->chip), bytes, count);
	if (count == 0)
		console_answer_hex(&runner->console, chip_eeprom(runner->chip), CHIP_EEPROM_BYTES);
	else
		console_answer(&runner->console, "ok");
}

static void command_tx(struct runner *runner, const char *rest)
{
	static uint8_t bytes[CHIP_LINE_BYTES];
	int count = console_unhex(rest, bytes, sizeof(bytes));

	if (count < 0 || !chip_send(runner->chip, bytes, count))
		console_answer(&runner->console,
			       "error: not hexadecimal, or more than the line holds");
	else
		console_answer(&runner->console, "ok");
}

static void execute(void *context, const char *line)
{
	struct runner *runner = context;
	struct chip *chip = runner->chip;
	char reply[2048], word[8];
	unsigned long long number;
	unsigned address, bits;
	int at = 0;

	if (sscanf(line, "run %llu", &number) == 1) {
		run_for(runner, number);
		console_answer(&runner->console, chip->dead ? "error: the chip is dead" : "ok");
	} else if (strcmp(line, "flush") == 0) {
		line_flush(&runner->line);
		console_answer(&runner->console, "ok");
	} else if (strcmp(line, "time") == 0) {
		console_answer(&runner->console, "%llu",
			       (unsigned long long)(chip->avr->cycle / CHIP_US(1)));
	} else if (strcmp(line, "resets") == 0) {
		console_answer(&runner->console, "%u", chip->resets);
	} else if (strcmp(line, "load") == 0) {
		uint64_t passed = chip->avr->cycle - chip->load_cycle;
		console_answer(&runner->console, "%.4f %.0f",
			       1 - (double)chip->asleep_cycles / passed,
			       chip->longest_awake_cycles / (CHIP_HZ / 1e6));
		chip->load_cycle = chip->avr->cycle;
		chip->asleep_cycles = chip->longest_awake_cycles = 0;
	} else if (strncmp(line, "tx ", 3) == 0) {
		command_tx(runner, line + 3);
	} else if (strcmp(line, "frames") == 0) {
		frame_log_answer(&chip->log, &runner->console);
	} else if (strcmp(line, "servo") == 0) {
		command_servo(runner);
	} else if (strncmp(line, "twi ", 4) == 0) {
		command_twi(runner, line + 4);
	} else if (strncmp(line, "can ", 4) == 0) {
		command_can(runner, line + 4);
	} else if (strcmp(line, "reset") == 0) {
		command_reset(runner, "external");
	} else if (strncmp(line, "reset ", 6) == 0) {
		command_reset(runner, line + 6);
	} else if (sscanf(line, "cut %u", &address) == 1) {
		command_cut(runner, address);
	} else if (strncmp(line, "eeprom", 6) == 0) {
		command_eeprom(runner, line + 6);
	} else if (sscanf(line, "worn %u %u", &address, &bits) == 2) {
		chip->worn_address = address % CHIP_EEPROM_BYTES;
		chip->worn_bits = (uint8_t)bits;
		chip->worn_held = chip_eeprom(chip)[chip->worn_address] & chip->worn_bits;
		console_answer(&runner->console, "ok");
	} else if (sscanf(line, "stack %i", (int *)&address) == 1) {
		command_stack(runner, address);
	} else if (sscanf(line, "%7s %i %n", word, (int *)&address, &at) == 2 &&
		   (strcmp(word, "flash") == 0 || strcmp(word, "ram") == 0)) {
		command_memory(runner, word, address, line + at);
	} else if (strcmp(line, "quit") == 0) {
		console_answer(&runner->console, "ok");
		runner->quit = true;
	} else if (world_command(&chip->world, line, reply, sizeof(reply))) {
		console_answer(&runner->console, "%s", reply);
	} else {
		console_answer(&runner->console, "error: unknown command");
	}
}

/* --- outside ------------------------------------------------------------------------------------
 */

static void on_line_out(void *context, uint8_t byte)
{
	struct runner *runner = context;

	size_t left = world_line(&runner->chip->world, &byte, 1);

	line_send(&runner->line, &byte, left);
}

static void on_can_frame(void *context, const struct can_record *record)
{
	struct runner *runner = context;
	struct can_log *log = &runner->can_log;

	log->t_us[log->end % CAN_FRAMES] = runner->chip->avr->cycle / CHIP_US(1);
	log->records[log->end++ % CAN_FRAMES] = *record;
	if (log->end - log->first > CAN_FRAMES)
		log->first = log->end - CAN_FRAMES;
	if (runner->can_client >= 0 &&
	    send(runner->can_client, record, sizeof(*record), MSG_NOSIGNAL | MSG_DONTWAIT) < 0)
		return;
}

static void take_can(struct runner *runner)
{
	struct can_record record;
	ssize_t got;

	if (runner->can_listener >= 0 && runner->can_client < 0)
		runner->can_client = accept4(runner->can_listener, NULL, NULL, SOCK_CLOEXEC);
	if (runner->can_client < 0)
		return;
	while ((got = recv(runner->can_client, &record, sizeof(record), MSG_DONTWAIT)) ==
	       sizeof(record))
		mcp2515_receive(runner->chip->can, &record);
	if (got == 0) {
		close(runner->can_client);
		runner->can_client = -1;
	}
}

static void take_from_outside(struct runner *runner)
{
	uint8_t bytes[1024];

	take_can(runner);
	line_plug(&runner->line, !runner->chip->world.line_unplugged);
	if (runner->line.master < 0)
		return;
	if (line_dtr_rose(&runner->line) && runner->chip->world.dtr_resets)
		chip_reset(runner->chip, CHIP_EXTERNAL);
	unsigned waiting = runner->chip->line_in_end - runner->chip->line_in_first;
	if (waiting > CHIP_LINE_BYTES - sizeof(bytes))
		return;
	ssize_t got = read(runner->line.master, bytes, sizeof(bytes));
	if (got > 0)
		chip_send(runner->chip, bytes, world_line(&runner->chip->world, bytes, got));
}

/* A file that is not there is a new chip's. */
static void load_eeprom(struct chip *chip, const char *path)
{
	FILE *file = path ? fopen(path, "rb") : NULL;

	if (!file)
		return;
	if (fread(chip_eeprom(chip), 1, CHIP_EEPROM_BYTES, file) != CHIP_EEPROM_BYTES)
		fprintf(stderr, "runner: %s: shorter than an EEPROM: the rest is blank\n", path);
	fclose(file);
}

static void save_eeprom(struct chip *chip, const char *path)
{
	FILE *file = path ? fopen(path, "wb") : NULL;

	if (path &&
	    (!file || fwrite(chip_eeprom(chip), 1, CHIP_EEPROM_BYTES, file) != CHIP_EEPROM_BYTES))
		perror(path);
	if (file)
		fclose(file);
}

/* --- main ---------------------------------------------------------------------------------------
 */

static int64_t now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return now.tv_sec * 1000000000LL + now.tv_nsec;
}

/* The wall clock leads; a machine too slow to follow is not caught up with for ever. */
static void run_real_time(struct runner *runner)
{
	int64_t offset_ns = now_ns();

	while (!runner->quit && !runner->console.closed && !runner->chip->dead) {
		run_for(runner, SLICE_US);
		int64_t chip_ns = (int64_t)(runner->chip->avr->cycle * (1e9 / CHIP_HZ));
		int64_t ahead_ns = chip_ns + offset_ns - now_ns();
		world_behind(&runner->chip->world, -ahead_ns * 1e-3);
		if (ahead_ns < -1000 * WORLD_BEHIND_US)
			offset_ns -= ahead_ns;
		runner->chip->world.start_ns = offset_ns;
		int wait_ms = ahead_ns > 1000000 ? (int)(ahead_ns / 1000000) : 0;
		console_serve(&runner->console, wait_ms, execute, runner);
		ahead_ns = chip_ns + offset_ns - now_ns();
		if (ahead_ns > 0) {
			struct timespec pause = {.tv_nsec = ahead_ns % 1000000000};
			nanosleep(&pause, NULL);
		}
	}
}

int main(int argc, char **argv)
{
	static struct runner runner = {.line = LINE_CLOSED, .can_listener = -1, .can_client = -1};
	const char *carrier = "serial", *eeprom = NULL, *control = NULL;
	uint32_t seed = 1;

	if (argc < 2 || strcmp(argv[1], "--help") == 0) {
		usage();
		return argc < 2 ? 2 : 0;
	}
	for (int i = 2; i < argc; i++) {
		const char *option = argv[i];
		if (strcmp(option, "--real-time") == 0) {
			runner.real_time = true;
			continue;
		}
		const char *value = ++i < argc ? argv[i] : "";
		if (strcmp(option, "--carrier") == 0)
			carrier = value;
		else if (strcmp(option, "--pty") == 0)
			runner.line.path = value;
		else if (strcmp(option, "--control") == 0)
			control = value;
		else if (strcmp(option, "--can") == 0)
			runner.can_listener = listen_on(value);
		else if (strcmp(option, "--eeprom") == 0)
			eeprom = value;
		else if (strcmp(option, "--seed") == 0)
			seed = strtoul(value, NULL, 0);
		else {
			fprintf(stderr, "runner: unknown option %s; --help lists them\n", option);
			return 2;
		}
	}
	srand(seed);
	console_open(&runner.console, control);
	runner.line.held = !runner.real_time;
	line_plug(&runner.line, true);
	runner.chip = chip_create(argv[1], carrier, seed);
	if (!runner.chip)
		return 1;
	load_eeprom(runner.chip, eeprom);
	runner.chip->line_out = on_line_out;
	runner.chip->line_out_context = &runner;
	mcp2515_on_frame(runner.chip->can, on_can_frame, &runner);
	if (runner.real_time)
		run_real_time(&runner);
	while (!runner.quit && !runner.console.closed && !runner.chip->dead && !runner.real_time)
		console_serve(&runner.console, -1, execute, &runner);
	int result = runner.chip->dead ? 3 : 0;
	save_eeprom(runner.chip, eeprom);
	line_plug(&runner.line, false);
	chip_destroy(runner.chip);
	console_close(&runner.console);
	return result;
}
