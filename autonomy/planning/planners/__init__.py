"""Planners behind one interface: plan(request) -> Plan."""
