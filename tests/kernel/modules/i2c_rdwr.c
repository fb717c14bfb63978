// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * An I2C bus with register-file chips on it that takes raw transfers (I2C_RDWR), which i2c-stub
 *does not. Each chip has 256 registers and a pointer: the first byte of a write sets the pointer,
 *further bytes are stored, reads start at the pointer.
 *
 *	insmod i2c_rdwr.ko chips=0x40,0x68
 *
 * Behind multiplexers (TCA9548A: the byte that is written is one bit per channel) there may be nine
 * sensors of one address, each with registers of two bytes, the lower one first: sensors 0 to 7 at
 *the channels of the first multiplexer, sensor 8 at channel 0 of the second. Two that are connected
 *at the same time answer together, as wires do: a bit is 0 if either pulls it down.
 *
 *	insmod i2c_rdwr.ko muxes=0x70,0x71 sensor=0x10
 *
 * Parameters that may be changed at run time, to misbehave:
 *	nack=ADDR	this chip does not answer (-1: all do)
 *	lost=N		the bus fails N more transfers with -EAGAIN (arbitration lost)
 */
#include <linux/i2c.h>
#include <linux/module.h>

#define MAX_CHIPS 8
#define SENSORS 9
#define CHANNELS 8

struct chip {
	u8 registers[256];
	u8 pointer;
};

static ushort chips[MAX_CHIPS];
static int chip_count;
module_param_array(chips, ushort, &chip_count, 0444);
static int nack = -1;
module_param(nack, int, 0644);
static int lost;
module_param(lost, int, 0644);

static struct chip files[MAX_CHIPS];

/* What a sensor sees may be set: words=SENSOR,REGISTER,VALUE (module parameter, written at run
 * time). */
static ushort muxes[2];
static int mux_count;
module_param_array(muxes, ushort, &mux_count, 0444);
static ushort sensor;
module_param(sensor, ushort, 0444);
static u8 connected[2];
static struct chip sensors[SENSORS];

static int set_word(const char *text, const struct kernel_param *param)
{
	unsigned int which, number, value;

	if (sscanf(text, "%u,%i,%i", &which, &number, &value) != 3 || which >= SENSORS ||
	    number > 127)
		return -EINVAL;
	sensors[which].registers[2 * number] = value & 0xff;
	sensors[which].registers[2 * number + 1] = value >> 8;
	return 0;
}

static int get_words(char *text, const struct kernel_param *param)
{
	int length = 0, i;

	for (i = 0; i < SENSORS; i++)
		length += sysfs_emit_at(text, length, "%u ",
					sensors[i].registers[0] | sensors[i].registers[1] << 8);
	return length;
}

static const struct kernel_param_ops word_ops = {.set = set_word, .get = get_words};
module_param_cb(words, &word_ops, NULL, 0644);
MODULE_PARM_DESC(words, "write SENSOR,REGISTER,VALUE; read register 0 of all sensors");

static struct chip *find_chip(u16 address)
{
	int i;

	if (address == nack)
		return NULL;
	for (i = 0; i < chip_count; i++)
		if (chips[i] == address)
			return &files[i];
	return NULL;
}

static void transfer_message(struct chip *chip, struct i2c_msg *message)
{
	int i;

	if (message->flags & I2C_M_RD) {
		for (i = 0; i < message->len; i++)
			message->buf[i] = chip->registers[chip->pointer++];
		return;
	}
	if (message->len)
		chip->pointer = message->buf[0];
	for (i = 1; i < message->len; i++)
		chip->registers[chip->pointer++] = message->buf[i];
}

static bool is_connected(int which)
{
	return connected[which / CHANNELS] >> which % CHANNELS & 1;
}

static int transfer_mux(int which, struct i2c_msg *message)
{
	if (message->flags & I2C_M_RD)
		memset(message->buf, connected[which], message->len);
	else if (message->len)
		connected[which] = message->buf[message->len - 1];
	return 0;
}

/* All that are connected take part. */
static int transfer_sensors(struct i2c_msg *message)
{
	int found = 0, k, i;

	if (message->flags & I2C_M_RD)
		memset(message->buf, 0xff, message->len);
	for (k = 0; k < SENSORS; k++) {
		struct chip *chip = &sensors[k];

		if (!is_connected(k))
			continue;
		found++;
		if (!(message->flags & I2C_M_RD) && message->len)
			chip->pointer = 2 * message->buf[0];
		for (i = message->flags & I2C_M_RD ? 0 : 1; i < message->len; i++) {
			if (message->flags & I2C_M_RD)
				message->buf[i] &= chip->registers[chip->pointer++];
			else
				chip->registers[chip->pointer++] = message->buf[i];
		}
	}
	return found ? 0 : -ENXIO;
}

/* -ENODEV: the message is for no multiplexer or sensor. */
static int transfer_behind(struct i2c_msg *message)
{
	int i;

	if (message->addr == nack)
		return -ENXIO;
	for (i = 0; i < mux_count; i++)
		if (message->addr == muxes[i])
			return transfer_mux(i, message);
	return sensor && message->addr == sensor ? transfer_sensors(message) : -ENODEV;
}

static int transfer(struct i2c_adapter *adapter, struct i2c_msg *messages, int count)
{
	int i;

	if (lost > 0) {
		lost--;
		return -EAGAIN;
	}
	for (i = 0; i < count; i++) {
		const int ret = transfer_behind(&messages[i]);
		struct chip *chip = find_chip(messages[i].addr);

		if (ret == 0)
			continue;
		if (ret != -ENODEV || !chip)
			return -ENXIO;
		transfer_message(chip, &messages[i]);
	}
	return count;
}

static u32 functionality(struct i2c_adapter *adapter)
{
	return I2C_FUNC_I2C | I2C_FUNC_SMBUS_EMUL;
}

static const struct i2c_algorithm algorithm = {
	.master_xfer = transfer,
	.functionality = functionality,
};

static struct i2c_adapter adapter = {
	.owner = THIS_MODULE,
	.name = "lightprobe register files",
	.algo = &algorithm,
};

static int __init i2c_rdwr_init(void)
{
	return i2c_add_adapter(&adapter);
}

static void __exit i2c_rdwr_exit(void)
{
	i2c_del_adapter(&adapter);
}

module_init(i2c_rdwr_init);
module_exit(i2c_rdwr_exit);
MODULE_DESCRIPTION("I2C bus of register files for lightprobe's tests");
MODULE_LICENSE("GPL");
