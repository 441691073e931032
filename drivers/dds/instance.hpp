// One plugin instance: what a wb_driver handle points to.
#pragma once
#include "drivers/dds/link.hpp"

struct wb_driver {
  wb::dds::DdsConfig config;
  wb::dds::Counters counters;
  wb::dds::Exchange exchange;
  wb::dds::Link link;
  wb_log log = nullptr;
  void* log_user = nullptr;
  wb_state state = WB_UNCONFIGURED;
  wb_diagnostics diagnostics{};

  // Connects; throws config::ConfigError naming what is missing.
  explicit wb_driver(wb::dds::DdsConfig c)
      : config(std::move(c)), exchange(config.paced), link(config, exchange, counters) {}
};
