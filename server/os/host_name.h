// Whom a browser believes to be talking to: the Host header, and the host of an Origin.
//
// A web page of elsewhere can have its own name point at 127.0.0.1 and then make a browser here ask us under
// that name (DNS rebinding). So a request counts only where it names a loopback address, or, for a server
// that listens elsewhere on purpose, an address at all: names can be rebound, addresses cannot.
#pragma once

#include <string_view>

namespace hapticd {

// "localhost", "127.…", "[::1]", each with or without a port.
bool is_loopback_host(std::string_view host);

// The above, or any other address (IPv4, or IPv6 in brackets).
bool is_address_host(std::string_view host);

// "localhost:8080" of "http://localhost:8080"; empty where it is none of http.
std::string_view host_of_origin(std::string_view origin);

}  // namespace hapticd
