"""The last word before the wire, and when control is taken or given back."""
