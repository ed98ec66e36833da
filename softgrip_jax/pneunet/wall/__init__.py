"""The walls of a chamber: arcs of finite strain, plates of small strain, and what pressure makes of them."""
