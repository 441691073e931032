// The bit rate that a CAN interface is set to, asked of the kernel by netlink. Setup world; nothing
// where the interface has none (vcan, vxcan) or the kernel does not say.
#pragma once
#include <cstdint>
#include <optional>

namespace wb::can {

std::optional<std::uint32_t> link_bit_rate(int interface_index);

}  // namespace wb::can
