//! Quality beside the oracle.
