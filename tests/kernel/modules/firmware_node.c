// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * Gives an emulated device the place in the firmware's tree that a real USB controller has:
 * libcamera names cameras by it. The place is that of the PCI bus.
 *
 *	insmod firmware_node.ko device=dummy_hcd.0
 */
#include <linux/acpi.h>
#include <linux/module.h>
#include <linux/platform_device.h>

static char *device = "dummy_hcd.0";
module_param(device, charp, 0444);

static struct device *bound;

static int __init firmware_node_init(void)
{
	struct acpi_device *place = acpi_dev_get_first_match_dev("PNP0A03", NULL, -1);
	int ret = -ENODEV;

	bound = bus_find_device_by_name(&platform_bus_type, NULL, device);
	if (place && bound)
		ret = acpi_bind_one(bound, place);
	if (place)
		acpi_dev_put(place);
	if (ret)
		put_device(bound);
	return ret;
}

static void __exit firmware_node_exit(void)
{
	acpi_unbind_one(bound);
	put_device(bound);
}

module_init(firmware_node_init);
module_exit(firmware_node_exit);
MODULE_DESCRIPTION("A firmware node for an emulated device");
MODULE_LICENSE("GPL");
