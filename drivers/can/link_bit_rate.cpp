#include "drivers/can/link_bit_rate.hpp"

#include <linux/can/netlink.h>
#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstring>

namespace wb::can {
namespace {

// The attribute of this type in a list of them, or null.
const rtattr* find(const rtattr* at, int bytes, int type) {
  for (; RTA_OK(at, bytes); at = RTA_NEXT(at, bytes)) {
    if ((at->rta_type & NLA_TYPE_MASK) == type) return at;
  }
  return nullptr;
}
const rtattr* find_in(const rtattr* nest, int type) {
  return nest ? find(static_cast<const rtattr*>(RTA_DATA(nest)),
                     static_cast<int>(RTA_PAYLOAD(nest)), type)
              : nullptr;
}

}  // namespace

std::optional<std::uint32_t> link_bit_rate(int interface_index) {
  const int socket = ::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
  if (socket < 0) return std::nullopt;
  struct {
    nlmsghdr header;
    ifinfomsg link;
  } request{};
  request.header.nlmsg_len = sizeof request;
  request.header.nlmsg_type = RTM_GETLINK;
  request.header.nlmsg_flags = NLM_F_REQUEST;
  request.link.ifi_index = interface_index;
  const timeval patience{1, 0};
  (void)::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  alignas(nlmsghdr) std::array<char, 16384> answer{};
  ssize_t n = -1;
  if (::send(socket, &request, sizeof request, 0) == static_cast<ssize_t>(sizeof request))
    n = ::recv(socket, answer.data(), answer.size(), 0);
  ::close(socket);
  const auto* header = reinterpret_cast<const nlmsghdr*>(answer.data());
  if (n <= 0 || !NLMSG_OK(header, static_cast<std::size_t>(n)) || header->nlmsg_type != RTM_NEWLINK)
    return std::nullopt;
  const auto* link = static_cast<const ifinfomsg*>(NLMSG_DATA(header));
  const rtattr* info = find(IFLA_RTA(link), static_cast<int>(IFLA_PAYLOAD(header)), IFLA_LINKINFO);
  const rtattr* timing = find_in(find_in(info, IFLA_INFO_DATA), IFLA_CAN_BITTIMING);
  if (!timing || RTA_PAYLOAD(timing) < sizeof(can_bittiming)) return std::nullopt;
  can_bittiming set;
  std::memcpy(&set, RTA_DATA(timing), sizeof set);
  if (set.bitrate == 0) return std::nullopt;
  return set.bitrate;
}

}  // namespace wb::can
